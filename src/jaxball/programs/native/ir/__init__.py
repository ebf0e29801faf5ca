"""StableHLO as data, and LLVM IR as text: elements, scopes, loops whose turns are independent."""
