"""The paper's ball in other integrators: the state is (θ, θ̇, q, Ω, z), the paper's fifteen numbers."""
