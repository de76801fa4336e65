"""`python -m rakelight`: the command line, where the program itself is not on the path."""

from rakelight.cli import main

if __name__ == "__main__":
    main()
