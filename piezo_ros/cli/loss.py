"""What the commands that read bags do with a damaged one, in one place."""

import argparse

__all__ = ['add_loss_option']


def add_loss_option(parser: argparse.ArgumentParser) -> None:
    """Let a command take what is whole of a damaged bag, unless it is told to refuse."""
    parser.add_argument(
        '--allow-loss', action=argparse.BooleanOptionalAction, default=True,
        help='take what is whole of a damaged bag, say what is lost, exit 3 (default); or refuse')
