"""What shows beside effects of a mean: noise that changes, wrong matches that crowd."""
