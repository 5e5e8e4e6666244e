"""What is guaranteed, tried at length."""
