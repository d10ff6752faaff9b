import pytest
import scipy.linalg  # noqa: F401  (the limits are set on libraries that are loaded)
from threadpoolctl import threadpool_info, threadpool_limits

from satsep_ot.methods.common.single_thread import singleThread


def threads():
    return [library["num_threads"] for library in threadpool_info() if library["user_api"] == "blas"]


def test_threads_are_as_before_afterwards():
    with threadpool_limits(2, user_api="blas"):
        before = threads()
        with singleThread():
            assert set(threads()) == {1}
        assert threads() == before


@singleThread()
def nested(depth):
    assert set(threads()) == {1}
    if depth:
        nested(depth - 1)
    assert set(threads()) == {1}


def test_nested_calls_of_a_decorated_function():
    with threadpool_limits(2, user_api="blas"):
        nested(2)
        assert set(threads()) == {2}


def test_threads_come_back_after_an_error():
    with threadpool_limits(2, user_api="blas"):
        with pytest.raises(KeyError), singleThread():
            raise KeyError
        assert set(threads()) == {2}
