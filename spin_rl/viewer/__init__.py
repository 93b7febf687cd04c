"""Looking at policies: videos without OpenGL, a view in the browser, a native window, plots.

All views read the same `rollout.Snapshot`, so they show the same overlays.
"""
