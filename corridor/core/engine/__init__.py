"""What is compiled: kernels of the normal equations and of covariances, threads, memory."""
