"""What a body cannot do: masses outside it, joints beyond their ends, equations without a solution."""
