"""Force lines: where and along which direction a spring pushes. A new one is two functions and a row of `ForceLine`.

A line takes, in platform axes, the vector `delta` from the platform's seat of a spring to the satellite's, the
direction n_1 of its guide, the satellite's y axis n_2, the stowed length l_0 and the friction coefficient mu_g of the
guides. It gives the stroke s, its gradient g with respect to the motion of the contact point, that point from the
platform's seat, and the share of the spring's force f that reaches the bodies. The force on the satellite is
F = share f g; its opposite acts on the platform at the same point, so momentum is exact, and without friction the power
is f ds/dt, so that a spring's work is the integral of f over its stroke.

Its adjoint takes the same, with f and df/ds, and the adjoints of F, of the point and of s. It gives those of f, delta,
n_1, n_2, l_0 and mu_g.

Hu et al. (2017), equations 4 to 8.
"""

import enum
from collections.abc import Callable
from typing import NamedTuple

from satsep_ot.dynamics.kernels.compilation import choice, inline, kernel
from satsep_ot.dynamics.kernels.records import LANES
from satsep_ot.dynamics.kernels.vectors import (
    ZERO,
    cross,
    dot,
    lane,
    minus,
    norm,
    plus,
    put_lane,
    scaled,
    vector,
)


def guided(delta, n_1, n_2, l_0, mu_g):
    """Along the guide, fixed in the platform, at the satellite's seat: s = delta . n_1, g = n_1."""
    return dot(delta, n_1), n_1, delta, 1.0


def guided_adjoint(delta, n_1, n_2, l_0, mu_g, f, slope, by_force, by_point, by_stroke):
    by_f = dot(by_force, n_1)
    by_s = by_stroke + slope * by_f
    by_n_1 = plus(scaled(f, by_force), scaled(by_s, delta))
    return by_f, plus(scaled(by_s, n_1), by_point), by_n_1, ZERO, 0.0, 0.0


def strut(delta, n_1, n_2, l_0, mu_g):
    """Along the line between ball ends, which start l_0 > 0 apart: s = |delta| - l_0, g = delta / |delta|.

    Hu et al. (2017), equation 8, is its limit l_0 -> 0, which is ill-posed: a zero-length strut buckles.
    """
    length = norm(delta)
    return length - l_0, scaled(1.0 / length, delta), delta, 1.0


def strut_adjoint(delta, n_1, n_2, l_0, mu_g, f, slope, by_force, by_point, by_stroke):
    length = norm(delta)
    g = scaled(1.0 / length, delta)
    by_f = dot(by_force, g)
    by_s = by_stroke + slope * by_f
    # The direction turns with the seats: dg = (1 - g g^T) d delta / |delta|.
    turning = scaled(f / length, minus(by_force, scaled(by_f, g)))
    return by_f, plus(plus(scaled(by_s, g), turning), by_point), ZERO, ZERO, -by_s, 0.0


def normal(delta, n_1, n_2, l_0, mu_g):
    """A rod in the guide whose foot slides on the satellite's plate, at s n_1: s = delta . n_2 / (n_1 . n_2).

    g = n_2 / (n_1 . n_2). The rod's balance along the guide, with the lateral load and the guide's friction, is
    f = N (n_1 . n_2 + mu_g |n_1 x n_2|) with the contact force N: friction takes the part of the work that it should.
    """
    cosine = dot(n_1, n_2)
    inverse = 1.0 / cosine
    s = dot(delta, n_2) * inverse
    # Of nearly parallel directions the cosine has lost what the sine is.
    sine = norm(cross(n_1, n_2))
    return s, scaled(inverse, n_2), scaled(s, n_1), cosine / (cosine + mu_g * sine)


def normal_adjoint(delta, n_1, n_2, l_0, mu_g, f, slope, by_force, by_point, by_stroke):
    # F = N n_2 with N = f / D, D = cosine + mu_g sine.
    cosine = dot(n_1, n_2)
    inverse = 1.0 / cosine
    s = dot(delta, n_2) * inverse
    # Of nearly parallel directions the cosine has lost what the sine is.
    sine = norm(cross(n_1, n_2))
    balance = cosine + mu_g * sine
    # The friction is kinked where rod and plate are aligned: 0 is one of its slopes there.
    bend = 1.0 - mu_g * cosine / sine if sine > 1e-12 else 1.0
    contact_force = f / balance
    by_f = dot(by_force, n_2) / balance
    by_s = (by_stroke + slope * by_f + dot(by_point, n_1)) * inverse
    by_balance = -by_f * contact_force
    by_cosine = by_balance * bend - by_s * s
    by_n_1 = plus(scaled(s, by_point), scaled(by_cosine, n_2))
    by_n_2 = plus(plus(scaled(contact_force, by_force), scaled(by_s, delta)), scaled(by_cosine, n_1))
    return by_f, scaled(by_s, n_2), by_n_1, by_n_2, 0.0, by_balance * sine


class Line(NamedTuple):
    """A row of `ForceLine`: the function of a line, its adjoint, and what is true of it."""

    function: Callable
    adjoint: Callable
    push: str  # how a spring pushes, in words: "each spring pushes ..."
    is_fixed: bool = False  # s is linear in d and the rotation matrix, n_1 the direction: springs are summed up
    has_stowed_length: bool = False  # l_0 > 0; it is 0 on other lines
    loads_guide: bool = False  # laterally: only then there is friction in it


class ForceLine(enum.IntEnum):
    """Along which line a spring pushes; each has the attributes of its `Line`."""

    GUIDED = Line(guided, guided_adjoint, "along its guide, fixed in the platform", is_fixed=True)
    STRUT = Line(strut, strut_adjoint, "along the line between its two ball ends", has_stowed_length=True)
    NORMAL = Line(
        normal, normal_adjoint, "by a foot that slides on the satellite's plate, square to it", loads_guide=True
    )

    function: Callable
    adjoint: Callable
    push: str
    is_fixed: bool
    has_stowed_length: bool
    loads_guide: bool

    def __new__(cls, *line):
        member = int.__new__(cls, len(cls.__members__))
        member._value_ = int(member)
        for name, value in Line(*line)._asdict().items():
            setattr(member, name, value)
        return member


_contact = choice([line.function for line in ForceLine])


@inline
def contact(system, spring, delta, n_2):
    """Stroke, gradient, contact point from the platform's seat and share of the force of a spring."""
    return _contact(system.force_line, delta, vector(spring.guide), n_2, system.stowed_length, system.guide_friction)


def _of_all_lanes(adjoint):
    adjoint = inline(adjoint)

    @kernel
    def of_all_lanes(system, spring, delta, n_2, f, slope, chain):
        n_1 = vector(spring.guide)
        l_0 = system.stowed_length
        mu_g = system.guide_friction
        for n in range(LANES):
            by_point = lane(chain.point, n)
            by_f, by_delta, by_n_1, by_n_2, by_l_0, by_mu_g = adjoint(
                delta, n_1, n_2, l_0, mu_g, f, slope, lane(chain.spring_force, n), by_point, chain.stroke[n]
            )
            chain.spring_size[n] = by_f
            put_lane(chain.seat, n, by_delta)
            put_lane(chain.plate, n, by_n_2)
            put_lane(chain.spring.platform_seat, n, minus(by_point, by_delta))
            put_lane(chain.spring.guide, n, by_n_1)
            chain.constants.stowed_length[n] += by_l_0
            chain.constants.guide_friction[n] += by_mu_g

    return of_all_lanes


_contact_adjoint = choice([_of_all_lanes(line.adjoint) for line in ForceLine])


@inline
def contact_adjoint(system, spring, delta, n_2, f, slope, chain):
    """From the adjoints of a spring's force, contact point and stroke in `chain` to all that they depend on.

    f is the spring's force with its scale and `slope` its derivative. Those of f, of delta and of n_2 go to
    `spring_size`, `seat` and `plate` of the chain, those of seat and guide to `chain.spring`; the others are added to
    those of the constants.
    """
    _contact_adjoint(system.force_line, system, spring, delta, n_2, f, slope, chain)
