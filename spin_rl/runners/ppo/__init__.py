"""Phase 1: PPO on sequences, and decoupled optimization (DVO)."""
