"""The paper's own simulations."""
