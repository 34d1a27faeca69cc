import signal

# A shell that starts us in the background has SIGINT ignored, and every child would inherit that: no Ctrl-C to test.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)
