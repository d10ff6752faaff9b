"""Processes below another one, and those of them that outlive it."""

import time

import psutil


def descendants(process, text=""):
    """The numbers of the processes below a process whose command holds a text."""
    found = set()
    try:
        children = psutil.Process(process).children(recursive=True)
    except psutil.NoSuchProcess:
        return found
    for child in children:
        try:
            if text in " ".join(child.cmdline()) and child.status() != psutil.STATUS_ZOMBIE:
                found.add(child.pid)
        except psutil.NoSuchProcess:
            pass
    return found


def survivors(processes, seconds=10.0):
    """Those that still run after some seconds, or as soon as there are none."""
    end = time.monotonic() + seconds
    while (left := {process for process in processes if _runs(process)}) and time.monotonic() < end:
        time.sleep(0.02)
    return left


def _runs(process):
    try:
        return psutil.Process(process).status() != psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return False
