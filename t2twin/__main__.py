"""The console command `t2twin`, which is also `python -m t2twin`."""

from t2twin.stopping import heed_signals


def main() -> None:
    """Run the command line; signals are heeded before the rest is loaded, which takes a while."""
    heed_signals()

    from t2twin.cli import main as run

    run()


if __name__ == "__main__":
    main()
