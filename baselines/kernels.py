"""The arithmetic of PPO on a small network, compiled: numpy would spend most of the time on the way from one call to the next.

All arrays are float32 unless said otherwise, and hidden layers have the features first, (features, n): so a bias is one number a row, actor and critic
share one product in the first layer, and their halves of every layer are contiguous, as BLAS (numpy's `dot`, here scipy's) wants them. No sum is reordered
and no product fused with a sum (`fastmath` is off), so that results do not hang on the processor; `mpge_bench.numerics` fixes the rest.

What a function is compiled for is kept beside this file or, where that cannot be written, in the user's cache. The cache knows when this file has changed
and no other; so constants of other modules come in as arguments.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt

from mpge_bench.envs.compiled import compiled

Array = npt.NDArray[Any]

#: tanh as a quotient of polynomials, as in Eigen: exact to three units in the last place, and several times faster than the C library's. Odd coefficients
#: 1 to 13 above, even ones 0 to 6 below; beyond the bound it is ±1 in float32.
_BOUND = np.float32(7.90531110763549805)
_A1, _A3, _A5, _A7 = np.float32(4.89352455891786e-03), np.float32(6.37261928875436e-04), np.float32(1.48572235717979e-05), np.float32(5.12229709037114e-08)
_A9, _A11, _A13 = np.float32(-8.60467152213735e-11), np.float32(2.00018790482477e-13), np.float32(-2.76076847742355e-16)
_B0, _B2, _B4, _B6 = np.float32(4.89352518554385e-03), np.float32(2.26843463243900e-03), np.float32(1.18534705686654e-04), np.float32(1.19825839466702e-06)
_ONE, _HALF = np.float32(1), np.float32(0.5)
_LOG_ROOT_TWO_PI = np.float32(0.5 * math.log(2 * math.pi))


@compiled
def _tanh_of(z: np.float32) -> np.float32:
    # Written as choices, not as min and max: those would keep a loop from being vectorised.
    z = _BOUND if z > _BOUND else z
    z = -_BOUND if z < -_BOUND else z
    s = z * z
    over = ((((((_A13 * s + _A11) * s + _A9) * s + _A7) * s + _A5) * s + _A3) * s + _A1) * z
    return over / (((_B6 * s + _B4) * s + _B2) * s + _B0)


@compiled
def _tanh(x: Array, bias: Array) -> None:
    """tanh(x + bias) in place, of rows (features, n)."""
    for row in range(x.shape[0]):
        shift = bias[row]
        for column in range(x.shape[1]):
            x[row, column] = _tanh_of(x[row, column] + shift)


@compiled
def layers(vector: Array, inputs: int, width: int, actions: int) -> tuple[Array, ...]:
    """The parts of a vector of parameters, or of their slopes, as views.

    Returns:
        Weights of the first layer, actor's and then critic's (2 width, inputs), and biases (2 width,); weights of the second, the actor's and the critic's
        (width, width), and biases of both (2 width,); weights (2 actions, width) and biases (2 actions,) of mean and log std; weights (width,) and bias (1,)
        of the value.
    """
    one = 2 * width * inputs
    one_bias = one + 2 * width
    two = one_bias + width * width
    three = two + width * width
    two_bias = three + 2 * width
    head = two_bias + 2 * actions * width
    head_bias = head + 2 * actions
    value = head_bias + width
    return (
        vector[:one].reshape(2 * width, inputs),
        vector[one:one_bias],
        vector[one_bias:two].reshape(width, width),
        vector[two:three].reshape(width, width),
        vector[three:two_bias],
        vector[two_bias:head].reshape(2 * actions, width),
        vector[head:head_bias],
        vector[head_bias:value],
        vector[value : value + 1],
    )


@compiled
def forward(parameters: Array, x: Array, width: int, actions: int) -> tuple[Array, Array, Array, Array, Array]:
    """Actor and critic at inputs `x`, (n, inputs).

    Returns:
        Both hidden layers' outputs, actor's and then critic's, (2 width, n) each; mean and unbounded log std, (n, actions) each; values (n,).
    """
    n = x.shape[0]
    first, first_bias, actor, critic, second_bias, head, head_bias, to_value, value_bias = layers(parameters, x.shape[1], width, actions)
    one = np.dot(first, x.T)
    _tanh(one, first_bias)
    two = np.empty_like(one)
    np.dot(actor, one[:width], two[:width])
    np.dot(critic, one[width:], two[width:])
    _tanh(two, second_bias)
    heads = np.dot(head, two[:width])
    mean, log_std = np.empty((n, actions), np.float32), np.empty((n, actions), np.float32)
    for row in range(n):
        for action in range(actions):
            mean[row, action] = heads[action, row] + head_bias[action]
            log_std[row, action] = heads[actions + action, row] + head_bias[actions + action]
    return one, two, mean, log_std, np.dot(to_value, two[width:]) + value_bias[0]


@compiled
def scaled(observations: Array, mean: Array, std: Array, most: float) -> Array:
    """Observations (n, o) in float64 less `mean`, in units of `std`, cut off at ±`most`; what `mean` (less than o long) has no entry for goes through."""
    found = np.empty(observations.shape, np.float32)
    for row in range(observations.shape[0]):
        for column in range(mean.size):
            found[row, column] = min(max((observations[row, column] - mean[column]) / std[column], -most), most)
        for column in range(mean.size, observations.shape[1]):
            found[row, column] = observations[row, column]
    return found


@compiled
def act(mean: Array, log_std: Array, noise: Array, limit: float, actions: Array, log_probabilities: Array) -> Array:
    """Write what a policy chooses, (n, actions) in units of the action limit, under standard normal `noise`, and its log probabilities (n,).

    Returns:
        What is executed of it, within ±`limit`, in float64.
    """
    executed = np.empty(mean.shape)
    for row in range(mean.shape[0]):
        probability = np.float32(0)
        for action in range(mean.shape[1]):
            one = noise[row, action]
            chosen = mean[row, action] + math.exp(log_std[row, action]) * one
            probability -= _HALF * one * one + log_std[row, action] + _LOG_ROOT_TWO_PI
            actions[row, action] = chosen
            executed[row, action] = min(max(chosen, -_ONE), _ONE) * limit
        log_probabilities[row] = probability
    return executed


@compiled
def _affine(x: Array, weight: Array, bias: Array) -> Array:
    """x (i,) times weight (i, j) plus bias (j,)."""
    found = bias.copy()
    for i in range(x.size):
        for j in range(found.size):
            found[j] += x[i] * weight[i, j]
    return found


@compiled
def _hidden(x: Array, weight: Array, bias: Array) -> Array:
    """A tanh layer's output (j,) for `x` (i,)."""
    found = _affine(x, weight, bias)
    for j in range(found.size):
        found[j] = _tanh_of(found[j])
    return found


@compiled
def outputs(x: Array, member: Array, first: tuple[Array, Array], second: tuple[Array, Array], head: tuple[Array, Array]) -> Array:
    """What one of K networks of two tanh layers makes of each row, (n, outputs); only the network that a row asks for is worked out.

    Args:
        x: inputs (n, inputs).
        member: which network, (n,).
        first, second, head: weights (K, inputs, outputs) and biases (K, outputs) of each layer.
    """
    found = np.empty((x.shape[0], head[1].shape[1]), np.float32)
    for row in range(x.shape[0]):
        one = member[row]
        hidden = _hidden(_hidden(x[row], first[0][one], first[1][one]), second[0][one], second[1][one])
        found[row] = _affine(hidden, head[0][one], head[1][one])
    return found


def no_rewards() -> Array:
    """Mean, variance and number of the discounted returns so far, for `scale_rewards` to go on with; as stable-baselines3's `RunningMeanStd` begins."""
    return np.array([0.0, 1.0, 1e-4])


@compiled
def scale_rewards(rewards: Array, discounted: Array, statistics: Array, gamma: float, most: float) -> Array:
    """Rewards (n,) in standard deviations of the discounted returns, cut off at ±`most`, as stable-baselines3's `VecNormalize` has them; all in float64.

    Args:
        rewards: of one step of n worlds.
        discounted: their returns so far, discounted by `gamma`; go on in place.
        statistics: of all of these; go on in place.
    """
    n = rewards.size
    for index in range(n):
        discounted[index] = discounted[index] * gamma + rewards[index]
    found = discounted.mean()
    variance = ((discounted - found) ** 2).mean()
    mean, spread, count = statistics
    total, apart = count + n, found - mean
    statistics[0] = mean + apart * n / total
    statistics[1] = (spread * count + variance * n + apart**2 * count * n / total) / total
    statistics[2] = total
    return np.minimum(np.maximum(rewards / math.sqrt(statistics[1] + 1e-8), -most), most)


@compiled
def _standardized(values: Array) -> Array:
    """`values` (n,) less their mean, in standard deviations."""
    total = np.float32(0)
    for value in values:
        total += value
    found: Array = values - total / np.float32(values.size)
    found /= np.sqrt(np.dot(found, found) / np.float32(values.size - 1)) + np.float32(1e-8)
    return found


@compiled
def loss_slopes(
    mean: Array,
    raw: Array,
    value: Array,
    actions: Array,
    old: Array,
    advantages: Array,
    returns: Array,
    bounds: tuple[float, float],
    clip: float,
    entropy: float,
) -> tuple[Array, Array, Array]:
    """Slopes of PPO's loss on a minibatch of n, as in stable-baselines3's `PPO.train`.

    Args:
        mean, raw: of the policy now and its log std, not yet within `bounds`, (n, actions).
        value: of the critic (n,).
        actions: chosen, (n, actions).
        old: log probabilities with which they were (n,).
        advantages, returns: (n,).
        bounds: lowest and highest log std.
        clip: range of the ratio of probabilities.
        entropy: coefficient of the bonus on it.

    Returns:
        By mean (n, actions), by mean and log std one below the other (2 actions, n), and by half the squared error of the value (n,), all as means over n.
    """
    n, size = mean.shape
    share, low, high, bonus = _ONE / np.float32(n), np.float32(1 - clip), np.float32(1 + clip), np.float32(entropy) / np.float32(n)
    least, most = np.float32(bounds[0]), np.float32(bounds[1])
    advantages = _standardized(advantages)
    to_mean, to_heads, missed = np.empty_like(mean), np.empty((2 * size, n), np.float32), np.empty(n, np.float32)
    distance, inverse = np.empty(size, np.float32), np.empty(size, np.float32)
    for row in range(n):
        probability = -np.float32(size) * _LOG_ROOT_TWO_PI
        for action in range(size):
            log_std = min(max(raw[row, action], least), most)
            inverse[action] = math.exp(-log_std)
            distance[action] = (actions[row, action] - mean[row, action]) * inverse[action]
            probability -= _HALF * distance[action] * distance[action] + log_std
        ratio = math.exp(probability - old[row])
        # The minimum of ratio and clipped ratio times advantage has no slope where the clipped one is the smaller.
        counts = ratio <= high if advantages[row] > 0 else ratio >= low
        slope = -ratio * advantages[row] * share if counts else np.float32(0)
        for action in range(size):
            to_mean[row, action] = to_heads[action, row] = slope * distance[action] * inverse[action]
            free = least <= raw[row, action] <= most
            to_heads[size + action, row] = slope * (distance[action] * distance[action] - _ONE) - bonus if free else np.float32(0)
        missed[row] = (value[row] - returns[row]) * share
    return to_mean, to_heads, missed


@compiled
def _through_tanh(slope: Array, found: Array) -> None:
    """Slopes before tanh, in place, from those behind it and what it `found`."""
    for row in range(slope.shape[0]):
        for column in range(slope.shape[1]):
            slope[row, column] *= _ONE - found[row, column] * found[row, column]


@compiled
def back(parameters: Array, gradient: Array, x: Array, one: Array, two: Array, to_heads: Array, to_value: Array, width: int) -> None:
    """Write the gradients of all layers, from the slopes of the heads (2 actions, n) and of the value (n,); other arguments as of `forward`."""
    n, inputs = x.shape
    actions = to_heads.shape[0] // 2
    _, _, actor, critic, _, head, _, value_weight, _ = layers(parameters, inputs, width, actions)
    first, first_bias, of_actor, of_critic, second_bias, of_head, head_bias, of_value, value_bias = layers(gradient, inputs, width, actions)
    ones = np.ones(n, np.float32)
    np.dot(to_heads, two[:width].T, of_head)
    np.dot(to_heads, ones, head_bias)
    np.dot(two[width:], to_value, of_value)
    value_bias[0] = np.dot(to_value, ones)
    slope = np.empty_like(two)
    np.dot(head.T, to_heads, slope[:width])
    for row in range(width):
        weight = value_weight[row]
        for column in range(n):
            slope[width + row, column] = weight * to_value[column]
    _through_tanh(slope, two)
    np.dot(slope[:width], one[:width].T, of_actor)
    np.dot(slope[width:], one[width:].T, of_critic)
    np.dot(slope, ones, second_bias)
    before = np.empty_like(one)
    np.dot(actor.T, slope[:width], before[:width])
    np.dot(critic.T, slope[width:], before[width:])
    _through_tanh(before, one)
    np.dot(before, x, first)
    np.dot(before, ones, first_bias)


@compiled
def shorten(gradient: Array, most: float) -> None:
    """Cut `gradient`, in place, to norm `most` if it is longer."""
    norm = math.sqrt(np.dot(gradient, gradient))
    if norm > most:
        gradient *= np.float32(most / (norm + 1e-6))


@compiled
def adam(values: Array, gradient: Array, mean: Array, square: Array, count: int, rate: float) -> None:
    """Step number `count` of Adam (Kingma & Ba 2015), all in place, with torch's order of operations and stable-baselines3's ε.

    Args:
        values: what is moved; the others are shaped alike.
        gradient: of what is to fall.
        mean, square: running ones of gradient and its square.
        count: from 1.
        rate: learning rate.
    """
    first, second = np.float32(0.9), np.float32(0.999)
    left, rest = np.float32(1 - 0.9), np.float32(1 - 0.999)
    spread = np.float32(math.sqrt(1 - 0.999**count))
    step, epsilon = np.float32(rate / (1 - 0.9**count)), np.float32(1e-5)
    for index in range(values.size):
        slope = gradient[index]
        mean[index] = mean[index] * first + slope * left
        square[index] = square[index] * second + slope * slope * rest
        values[index] -= mean[index] / (np.sqrt(square[index]) / spread + epsilon) * step
