"""Showing how far long work is: by tqdm where that is installed, in a terminal and in a notebook."""

from __future__ import annotations

import sys
import time
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, Optional, Union

#: Told a share from 0 to 1, or None where that is not known, and words.
Told = Callable[[Optional[float], str], object]
#: True and False show and hide; None shows where somebody looks on.
Progress = Union[None, bool, Told]


@contextmanager
def shown(progress: Progress, title: str) -> Iterator[Optional[Told]]:
    """What to tell of work: a caller's own function, or a bar that goes when the work has ended."""
    if callable(progress):
        yield progress
        return
    watched = "ipykernel" in sys.modules or sys.stderr is not None and sys.stderr.isatty()
    if progress is False or (progress is None and not watched):
        yield None
        return
    try:
        with warnings.catch_warnings():
            # A notebook without widgets gets lines of text.
            warnings.simplefilter("ignore")
            from tqdm.auto import tqdm
    except ImportError:
        yield _lines(title) if progress else None
        return
    bar: Any = tqdm(total=1.0, desc=title, leave=False, bar_format="{desc} {bar} {elapsed}{postfix}")

    drawn_s = 0.0

    def tell(share: Optional[float], words: str) -> None:
        nonlocal drawn_s
        if share is not None:
            bar.n = share
        if time.monotonic() - drawn_s > 0.2:
            drawn_s = time.monotonic()
            bar.set_postfix_str(words)

    try:
        yield tell
    finally:
        bar.close()


def _lines(title: str) -> Told:
    """Where there is no tqdm: a line for each new word."""
    last: list[str] = [""]

    def tell(_: Optional[float], words: str) -> None:
        if words != last[0]:
            print(f"{title}: {words}", file=sys.stderr)
            last[0] = words

    return tell
