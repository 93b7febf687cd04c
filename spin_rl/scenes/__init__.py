"""What a world contains: layout arrays, the corridor generator, scene files, and their MuJoCo geoms."""

from spin_rl.scenes.layout import Layout, PoolSpec, Scene

__all__ = ["Layout", "PoolSpec", "Scene"]
