from threadpoolctl import threadpool_info, threadpool_limits

from satsep_ot.methods.single_thread import singleThread


def threads():
    return [library["num_threads"] for library in threadpool_info() if library["user_api"] == "blas"]


def test_threads_are_as_before_afterwards():
    with threadpool_limits(2, user_api="blas"):
        before = threads()
        with singleThread():
            assert set(threads()) == {1}
        assert threads() == before
