"""`python -m hoopd`."""

from hoopd.cli import main

if __name__ == "__main__":
    main()
