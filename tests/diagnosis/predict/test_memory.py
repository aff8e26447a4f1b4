"""What was asked for last is known, what was asked for long ago is made anew, and nothing travels."""

from __future__ import annotations

import pickle

from mpge_bench.diagnosis.predict.memory import Memory


def test_the_last_results_are_known() -> None:
    made: list[int] = []

    def square(number: int) -> int:
        made.append(number)
        return number**2

    memory: Memory[int, int] = Memory(2)
    for number in (1, 2, 1, 3, 1, 2):
        assert memory.get(number, lambda number=number: square(number)) == number**2  # type: ignore[misc]
    # 1 was asked for again before 3 came, so that 2 went.
    assert made == [1, 2, 3, 2]
    copied: Memory[int, int] = pickle.loads(pickle.dumps(memory))
    assert copied.get(1, lambda: 7) == 7
