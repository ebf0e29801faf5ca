"""A pendulum drives a disk to a point: a policy trained by PPO of skrl, through Gymnasium's interface.

It needs skrl, `pip install 'jaxball[environments]' 'skrl[jax]'`, and takes a minute or two. The policy is learned from
rewards alone, without gradients through the simulation; docs/tutorials/training-a-policy.md uses these.
"""

import flax.linen as nn
import jax
import jax.numpy as jnp
import numpy as np
from skrl import config
from skrl.agents.jax.ppo import PPO, PPO_CFG
from skrl.envs.wrappers.jax import wrap_env
from skrl.memories.jax import RandomMemory
from skrl.models.jax import DeterministicMixin, GaussianMixin, Model
from skrl.trainers.jax import SequentialTrainer, SequentialTrainerCfg

import jaxball
from jaxball.control.environments import Environment, ObservedState, QuadraticReward, ReachPoint, Uniform

jax.config.update("jax_enable_x64", True)
LANES, SAMPLES, STEPS = 64, 50, 4000

motor = jaxball.Motor(0.0, limit=1.5) + jaxball.Damper(0.2)
robot = jaxball.Disk(
    mass=1.0,
    inertia=0.5,
    gravity=10.0,
    mechanisms=[jaxball.planar_pendulum(0.8, 0.5, drive=motor)],
    resistance=jaxball.Resistance(rolling=0.05),
)
environment = Environment(
    robot,
    ReachPoint(drawn=Uniform(-2.0, 2.0)),
    sample=0.1,
    samples=SAMPLES,
    observation=ObservedState(attitude=False, joints=False),
    reward=QuadraticReward(misses=(1.0, 0.1), inputs=0.02),
)


class Policy(GaussianMixin, Model):
    """Mean actions and their spread."""

    def __init__(self, **given):
        Model.__init__(self, **given)
        GaussianMixin.__init__(self, clip_actions=True)

    @nn.compact
    def __call__(self, inputs, role):
        x = nn.tanh(nn.Dense(32)(inputs["observations"]))
        x = nn.tanh(nn.Dense(32)(x))
        spread = self.param("log_std", lambda _: -0.7 * jnp.ones(self.num_actions, jnp.float32))
        return nn.tanh(nn.Dense(self.num_actions)(x)), {"log_std": spread}


class Value(DeterministicMixin, Model):
    """The return that is expected."""

    def __init__(self, **given):
        Model.__init__(self, **given)
        DeterministicMixin.__init__(self)

    @nn.compact
    def __call__(self, inputs, role):
        x = nn.tanh(nn.Dense(32)(inputs["observations"]))
        x = nn.tanh(nn.Dense(32)(x))
        return nn.Dense(1)(x), {}


def trained(env):
    """An agent that was trained for STEPS steps of all lanes."""
    config.jax.key = 1
    spaces = {"observation_space": env.observation_space, "action_space": env.action_space, "device": env.device}
    models = {"policy": Policy(**spaces), "value": Value(**spaces)}
    for role, model in models.items():
        model.init_state_dict(role=role)
    cfg = PPO_CFG(rollouts=SAMPLES, learning_epochs=5, mini_batches=4, learning_rate=1e-3, discount_factor=0.98)
    cfg.experiment.write_interval = cfg.experiment.checkpoint_interval = 0
    memory = RandomMemory(memory_size=SAMPLES, num_envs=LANES, device=env.device)
    agent = PPO(models=models, memory=memory, cfg=cfg, **spaces)
    settings = SequentialTrainerCfg(timesteps=STEPS, headless=True, disable_progressbar=True)
    SequentialTrainer(env=env, agents=agent, cfg=settings).train()
    return agent


def away(env, act):
    """How far from its point each robot is after an episode."""
    seen, _ = env.reset(seed=1000)
    for _ in range(SAMPLES):
        seen, _, _, _, infos = env.step(act(seen))
    return np.abs(infos["misses"][:, 0])


agent = trained(wrap_env(environment.gymnasium_vector(LANES), wrapper="gymnasium"))
policy = agent.models["policy"]


def mean_action(seen):
    return np.asarray(policy.apply(policy.state_dict.params, {"observations": jnp.asarray(seen)}, "policy")[0])


many = environment.gymnasium_vector(LANES)
still, learned = away(many, lambda seen: np.zeros((LANES, 1), np.float32)), away(many, mean_action)
print(f"Median distance from the point at the end: {np.median(learned):.2f}; with motors off, {np.median(still):.2f}")
