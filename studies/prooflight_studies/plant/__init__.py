"""Study of what a plant needs: causes of defects named from a run's journal, and corrections in a closed loop."""
