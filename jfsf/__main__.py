"""`python -m jfsf` is `jfsf`."""

from jfsf.cli import main

if __name__ == "__main__":
    main()
