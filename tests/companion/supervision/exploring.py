"""Breadth-first search over all states that a machine can reach by a finite set of inputs."""

import copy
from collections import deque
from dataclasses import dataclass


@dataclass
class Explored:
    """What a search found: a machine for each key of a state, and how many steps were tried."""

    states: dict
    transitions: int = 0


def explore(start, key, inputs, step, most=10**7):
    """Search from `start`; return every state that can be reached.

    key(machine): what tells two states apart; states of one key must behave alike. inputs: a list,
    or a function of the machine. step(machine, input): moves the machine, which is a copy, and
    asserts what has to hold of that step. most: transitions, beyond which the search fails.
    """
    found = Explored({key(start): start})
    waiting = deque([start])
    while waiting:
        before = waiting.popleft()
        for given in inputs(before) if callable(inputs) else inputs:
            after = copy.copy(before)
            step(after, given)
            found.transitions += 1
            assert found.transitions <= most, "the state space is not as small as it was thought"
            name = key(after)
            if name not in found.states:
                found.states[name] = after
                waiting.append(after)
    return found
