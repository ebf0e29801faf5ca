"""Steps per second of the pendulum robot as an environment, by the number of lanes.

Steps are those of ``step_or_reset``, with observation, reward, and everything drawn anew where an episode is over.
Times are those of the processor, of one thread, least of all rounds; the last column is the time that passed for two
threads, each with so many lanes. A gradient is that of the cost of an episode of 60 steps by 240 weights.

    python benchmarks/environments.py
"""

import harness

arguments = harness.parser(__doc__ or "", rounds=20)


def environment():
    """The robot of the tutorial on training."""
    import jaxball
    from jaxball.control.environments import Environment, Factor, ObservedState, ReachPoint, Uniform

    ahead = jaxball.Motor(0.0, limit=3.0) + jaxball.Damper(0.3)
    stops = jaxball.EndStops(-0.8, 0.8, stiffness=30.0, damping=0.2)
    aside = jaxball.Motor(0.0, limit=2.0) + jaxball.Damper(0.3) + stops
    robot = jaxball.Ball(
        mass=1.0,
        inertia=(0.4, 0.4, 0.4),
        gravity=10.0,
        mechanisms=[jaxball.spherical_pendulum(0.8, 0.5, drives=(ahead, aside))],
        resistance=jaxball.Resistance(rolling=0.05, spinning=0.05),
    )
    return Environment(
        robot,
        ReachPoint(drawn=Uniform(-2.0, 2.0)),
        sample=0.1,
        samples=60,
        observation=ObservedState(attitude=False, joints=False),
        starts={"attitude[2]": Uniform(-3.0, 3.0)},
        parameters={"mass": Uniform(0.9, 1.1), "mechanisms[0].mass": Factor(Uniform(0.9, 1.1))},
        delay=(0, 1),
    )


def steps(lanes: int, rounds: int) -> dict[str, float]:
    """What a step takes, and how long the first call took."""
    import time
    from concurrent.futures import ThreadPoolExecutor

    import jax
    import numpy as np

    import jaxball
    from jaxball.control.environments import in_lanes

    here = environment()
    reset, step = jaxball.jit(in_lanes(here.reset)), jaxball.jit(in_lanes(here.step_or_reset))
    actions = np.random.default_rng(0).uniform(-1.0, 1.0, (lanes, here.n_actions))

    def begun(seed: int):
        return reset(jax.random.split(jax.random.key(seed), lanes))[0]

    first, after = harness.timed(lambda: jax.block_until_ready(step(begun(0), actions)))

    def several(episodes, count: int = 20):
        for _ in range(count):
            episodes = step(episodes, actions).episode
        return jax.block_until_ready(episodes)

    least, both = np.inf, np.inf
    halves = after.episode, begun(1)
    with ThreadPoolExecutor(2) as pool:
        for _ in range(rounds):
            start = time.process_time()
            halves = several(halves[0]), halves[1]
            least = min(least, time.process_time() - start)
            start = time.perf_counter()
            halves = tuple(pool.map(several, halves))
            both = min(both, time.perf_counter() - start)
    return {
        "first_s": first,
        "step_us": 1e6 * least / (20 * lanes),
        "per_second_one_thread": 20 * lanes / least,
        "per_second_two_threads": 2 * 20 * lanes / both,
    }


def gradient(lanes: int, rounds: int) -> dict[str, float]:
    """What a step with its part of a gradient takes, and how long the first call took."""
    import time

    import jax
    import jax.numpy as jnp
    import numpy as np

    import jaxball
    from jaxball.control.environments import in_lanes

    here = environment()
    shapes = {"V": (here.n_actions, 16), "W": (16, here.n_observations)}
    weights = {name: 0.1 * jax.random.normal(jax.random.key(1), shape) for name, shape in shapes.items()}

    def cost(weights, key):
        def policy(seen):
            return jnp.tanh(weights["V"] @ jnp.tanh(weights["W"] @ seen))

        return -jnp.sum(here.rollout(key, policy).reward)

    every = jaxball.jit(in_lanes(lambda key: jax.grad(cost)(weights, key)))
    keys = jax.random.split(jax.random.key(0), lanes)
    first, _ = harness.timed(lambda: jax.block_until_ready(every(keys)))
    least = np.inf
    for _ in range(rounds):
        start = time.process_time()
        jax.block_until_ready(every(keys))
        least = min(least, time.process_time() - start)
    return {"first_s": first, "step_us": 1e6 * least / (lanes * here.samples)}


def main() -> None:
    given = arguments.parse_args()
    harness.set_up_jax(cpu_settings=False)
    found: dict[str, object] = {"steps": {}, "gradient": {}}
    print("lanes  a step     per second, one thread    two threads    first call")
    for lanes in (16, 64, 256, 1024):
        row = found["steps"][lanes] = steps(lanes, given.rounds)  # pyright: ignore
        print(
            f"{lanes:5}  {row['step_us']:6.2f} us  {row['per_second_one_thread']:23,.0f}  "
            f"{row['per_second_two_threads']:13,.0f}  {row['first_s']:10.1f} s"
        )
    row = found["gradient"][64] = gradient(64, max(1, given.rounds // 4))  # pyright: ignore
    print(f"A step and its gradient, 64 lanes: {row['step_us']:.1f} us, first call {row['first_s']:.1f} s")
    harness.write_json(given.json, harness.description() | found)


if __name__ == "__main__":
    main()
