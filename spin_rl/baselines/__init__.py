"""What the learned policies are compared with, as policies of the same kind."""
