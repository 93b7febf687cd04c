"""What all tasks share: the environment, episodes, statistics, proprioception, images."""
