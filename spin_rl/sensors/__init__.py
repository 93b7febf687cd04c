"""Sensors: preallocated buffers with one ``update()`` each, over a kernel of ``spin_rl.warp_kernels``."""
