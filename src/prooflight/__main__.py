"""``python -m prooflight``."""

from prooflight.cli import main

if __name__ == "__main__":
    main()
