"""What the grounding methods share: the augmented MDP, the action transformation policy, the discriminator."""
