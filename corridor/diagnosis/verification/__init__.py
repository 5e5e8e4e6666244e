"""What data that no fit has used say of what was found."""
