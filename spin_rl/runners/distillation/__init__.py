"""Phase 2: a student that sees depth learns from a teacher that does not (SPIN 2.2)."""
