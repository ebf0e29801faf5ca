"""From StableHLO to LLVM IR: arrays in registers or memory, and one rule for each operation."""
