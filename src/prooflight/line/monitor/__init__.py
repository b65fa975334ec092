"""What a run says that no page of it says: control charts of inks, registers and streaks."""
