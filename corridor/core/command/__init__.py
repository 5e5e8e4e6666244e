"""What verbs of the command have in common: options, progress, the model they are told."""
