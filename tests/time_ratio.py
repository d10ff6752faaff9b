"""How long one thing takes in units of another, on a machine that may be busy."""

import time


def time_ratio(one, other, rounds=10):
    """The least processor time of `one` over that of `other`: they take turns, so that noise meets both."""
    least = [float("inf"), float("inf")]
    for _ in range(rounds):
        for i, function in enumerate((one, other)):
            start = time.process_time()
            function()
            least[i] = min(least[i], time.process_time() - start)
    return least[0] / least[1]
