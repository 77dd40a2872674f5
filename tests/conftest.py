"""One thread for every library, set before any of them is imported; Ctrl-C is heard even where a shell started the tests in
the background."""
import os
import signal

for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(name, "1")
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:        # what tests start would inherit it, and not be interrupted
    signal.signal(signal.SIGINT, signal.default_int_handler)
