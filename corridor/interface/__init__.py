"""What people meet: the command, reports, figures."""
