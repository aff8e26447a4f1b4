"""``python -m mpge_bench``."""

from mpge_bench.cli import main

if __name__ == "__main__":
    main()
