"""The low-dimensional safe region: t-SNE, the state mapping Ψ, the safety map Γ, the hypothesis h."""
