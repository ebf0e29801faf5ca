"""What identifies a program in any process: names, code, captured values; and whether it reads anything else."""
