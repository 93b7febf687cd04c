"""What a world contains: layout arrays, the corridor generator, scene files, and their MuJoCo geoms."""
