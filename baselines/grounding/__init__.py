"""What the grounding methods share: the source run backwards, the augmented MDP, the action transformation policy, the discriminator, networks."""
