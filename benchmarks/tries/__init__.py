"""What newcomers type: some two hundred tries with what has to come of each.

python -m benchmarks.tries [--short] [--only NUMBER,NUMBER] [--show]
"""
