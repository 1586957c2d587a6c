"""Raw video frames from standard input to standard output, for `fullsphere remap --raw`: reading, remapping and writing
overlap.

Reading and writing may wait without end for the programs at the other ends of the pipes, and nothing can call a thread
back from there: both are daemons, so that the process can end whatever they wait for.
"""

from __future__ import annotations

import contextlib
import os
import threading
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

from fullsphere.cli.channel import LOOK_UP_S, Channel, ClosedError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from fullsphere.model.raw_frames import RawFormat

    Frame = NDArray[Any]
    Wrap = Callable[[Iterable[Frame]], Iterable[Frame]]

STDIN, STDOUT = "standard input", "standard output"

_PIPE_BYTES = 1 << 20  # what Linux lets everyone have; 64 kB are usual


def remap_frames(
    source: RawFormat,
    target: RawFormat,
    remapped: Callable[[Frame], Frame],
    watch: Wrap = lambda frames: frames,
    pipes: tuple[int, int] = (0, 1),
) -> int:
    """Remap frames until standard input ends; answer how many there were.

    Parameters
    ----------
    source, target
        What is read, and what is written.
    remapped
        From a frame of the source to one of the target; runs in this thread.
    watch
        Wraps the iterable of frames, to show how far the work is.
    pipes
        Descriptors to read from and to write to.

    Raises
    ------
    InputError
        If standard input cannot be read, ends within a frame, or holds none; the frames before are written.
    BrokenPipeError
        If the reader of standard output has gone.
    OutputError
        If standard output takes no more for another reason.
    """
    from fullsphere.model.errors import InputError
    from fullsphere.model.files import input_errors, output_errors

    inbox: Channel[Frame] = Channel()
    outbox: Channel[Frame] = Channel()
    count, fault = 0, None
    with input_errors(Path(STDIN)):
        coming = _unbuffered(pipes[0], "rb")
    with output_errors(Path(STDOUT)):
        going = _unbuffered(pipes[1], "wb")
    with contextlib.ExitStack() as stack:
        stack.callback(outbox.close)
        stack.callback(inbox.close)
        threading.Thread(target=_read, args=(coming, source, inbox), daemon=True).start()
        writing = threading.Thread(target=_write, args=(going, target, outbox, inbox), daemon=True)
        writing.start()
        try:
            for frame in watch(inbox):
                outbox.give(remapped(frame))
                count += 1
        except InputError as error:  # the frames before it are on their way
            fault = error
        outbox.end()
        while writing.is_alive():
            writing.join(LOOK_UP_S)
        outbox.check()
    if fault is not None:
        raise fault
    return count


def _read(stream: BinaryIO, form: RawFormat, inbox: Channel[Frame]) -> None:
    from fullsphere.model.raw_frames import read_frames

    try:
        for frame in read_frames(stream, form, STDIN):
            inbox.give(frame)  # with room for one, a frame is done with when the second one after it was given
        inbox.end()
    except ClosedError:
        pass
    except BaseException as error:  # for the main thread
        inbox.end(error)


def _write(stream: BinaryIO, form: RawFormat, outbox: Channel[Frame], inbox: Channel[Frame]) -> None:
    from fullsphere.model.errors import OutputError
    from fullsphere.model.raw_frames import write_frame

    try:
        for frame in outbox:
            write_frame(stream, frame, form)
    except BaseException as error:  # for the main thread, whichever channel it waits at
        fault: BaseException = error
        if isinstance(error, OSError) and not isinstance(error, BrokenPipeError):
            fault = OutputError(f"{STDOUT}: cannot be written ({error.strerror}); make room")
        outbox.close(fault)
        inbox.close(fault)


def _unbuffered(descriptor: int, mode: str) -> BinaryIO:
    """A stream that holds no lock while it waits: a buffered one would let the process not end."""
    with contextlib.suppress(ImportError, OSError, AttributeError):  # no pipe, or no Linux
        import fcntl

        fcntl.fcntl(descriptor, fcntl.F_SETPIPE_SZ, _PIPE_BYTES)
    return os.fdopen(descriptor, mode, buffering=0, closefd=False)  # type: ignore[return-value]
