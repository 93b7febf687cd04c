"""Phase 2 in two processes: one collects, one learns (SPIN supplement, asynchronous DAgger)."""
