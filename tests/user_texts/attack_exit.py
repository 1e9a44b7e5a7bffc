import atexit
import os
import signal

signal.signal(signal.SIGTERM, signal.SIG_IGN)
atexit.register(os._exit, 0)
