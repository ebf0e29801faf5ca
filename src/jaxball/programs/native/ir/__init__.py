"""StableHLO as data, and LLVM IR as text: elements, modules, turns of loops."""
