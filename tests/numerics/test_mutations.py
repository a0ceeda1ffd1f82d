"""The faults of ``scripts/mutate`` can still be put in; that they are noticed is shown by running it."""

from __future__ import annotations

import pytest

from tests.numerics.mutations import MUTATIONS, Mutation, occurrences


@pytest.mark.parametrize("mutation", MUTATIONS, ids=lambda mutation: mutation.fault)
def test_a_fault_still_has_its_place(mutation: Mutation) -> None:
    assert occurrences(mutation) == 1, mutation.file
    assert mutation.right != mutation.wrong


def test_faults_are_told_apart() -> None:
    assert len({mutation.fault for mutation in MUTATIONS}) == len(MUTATIONS) >= 20
