"""What the tests of several hosts and of secured domains share: checks that are printed, files, and a domain."""
import os
import socket

failures = []


def check(condition, what):
    """Prints the result and collects failures. Returns `condition`."""
    print(("ok      " if condition else "FAILED  ") + what, flush=True)
    if not condition:
        failures.append(what)
    return condition


def read(path):
    with open(path) as text:
        return text.read()


def own_domain():
    """Reserves a DDS domain until the result's socket is closed, as tests/support/own_domain.hpp does."""
    for attempt in range(49):
        domain = 51 + (os.getpid() + attempt) % 49
        reservation = socket.socket()
        try:
            reservation.bind(("127.0.0.1", 20000 + domain))
            reservation.listen(1)
            return str(domain), reservation
        except OSError:
            reservation.close()
    raise RuntimeError("all domains from 51 to 99 are reserved by tests")
