"""The one exception that means 'the user can put this right'; the command line prints it as one line and exits with 2."""

#: Characters of one line: a value that is quoted in it may be a million long, and names of files and choices stand at its ends.
_LONGEST = 1500


class UserError(Exception):
    """Says in one line what is wrong, where, and what to do about it."""


def one_line(error: BaseException, *, named: bool = False) -> str:
    """What `error` says, in one line that a terminal can show, its middle left out where it is too long; `named` puts its type before it."""
    words = " ".join((f"{type(error).__name__}: {error}" if named else str(error)).split())
    if len(words) > _LONGEST:
        words = f"{words[: _LONGEST // 2]} … {words[-_LONGEST // 2 :]}"
    return "".join(letter if letter.isprintable() else "�" for letter in words)
