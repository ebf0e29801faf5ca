"""The function by which Python calls a compiled program, as LLVM IR, with the check for signals, such as Ctrl-C."""

from collections.abc import Sequence

from ..emit.functions import Result
from ..emit.lowering import INTERRUPTED_CODE, REFUSED
from ..limits import PATIENCE

# The control data of a program: the instructions left until it next checks for signals, whether it must stop, the state
# of Python's thread, which has released Python's lock, and where it says that all threads must stop, if it has several.
_SUPPORT = f"""
declare ptr @PyEval_SaveThread()
declare void @PyEval_RestoreThread(ptr)
declare i32 @PyErr_CheckSignals()

define internal i1 @looks_for_signals(ptr %control) noinline cold {{
entry:
  %place = getelementptr i8, ptr %control, i64 8
  %state.place = getelementptr i8, ptr %control, i64 16
  %before = load i8, ptr %place
  %stopped = icmp ne i8 %before, 0
  br i1 %stopped, label %stop, label %look
look:
  store i64 {PATIENCE}, ptr %control
  %state = load ptr, ptr %state.place
  call void @PyEval_RestoreThread(ptr %state)
  %raised = call i32 @PyErr_CheckSignals()
  %new = call ptr @PyEval_SaveThread()
  store ptr %new, ptr %state.place
  %interrupted = icmp ne i32 %raised, 0
  br i1 %interrupted, label %interrupt, label %others
others:
  %all.place = getelementptr i8, ptr %control, i64 24
  %all = load ptr, ptr %all.place
  %alone = icmp eq ptr %all, null
  br i1 %alone, label %continue, label %together
together:
  %all.stopped = load atomic i64, ptr %all seq_cst, align 8
  %stop.all = icmp ne i64 %all.stopped, 0
  br i1 %stop.all, label %interrupt, label %continue
interrupt:
  store i8 {INTERRUPTED_CODE}, ptr %place
  br label %stop
stop:
  store i64 -1, ptr %control
  ret i1 true
continue:
  ret i1 false
}}

define i32 @run(ptr %inputs, ptr %block, ptr %workspace) {{
OUTPUTS
  %control = alloca [32 x i8], align 8
  %all.place = getelementptr i8, ptr %control, i64 24
  store ptr null, ptr %all.place
  %place = getelementptr i8, ptr %control, i64 8
  %state.place = getelementptr i8, ptr %control, i64 16
  %state = call ptr @PyEval_SaveThread()
  store i64 {PATIENCE}, ptr %control
  store i8 0, ptr %place
  store ptr %state, ptr %state.place
  call void @main(ptr %control, ptr %workspace, ptr %inputs, ptr %outputs)
  %last = load ptr, ptr %state.place
  call void @PyEval_RestoreThread(ptr %last)
  %stopped = load i8, ptr %place
  %refused = icmp eq i8 %stopped, {REFUSED}
  %result = zext i1 %refused to i32
  ret i32 %result
}}
"""


def python_call(results: Sequence[Result]) -> str:
    """Writes ``run(inputs, block, workspace)``, whose results all lie in one array, ``block``."""
    lines = [f"%outputs = alloca [{max(len(results), 1)} x ptr], align 8"]
    for position, result in enumerate(results):
        lines.append(f"%output.{position} = getelementptr i8, ptr %block, i64 {result.offset}")
        lines.append(f"%output.place.{position} = getelementptr i8, ptr %outputs, i64 {8 * position}")
        lines.append(f"store ptr %output.{position}, ptr %output.place.{position}")
    return _SUPPORT.replace("OUTPUTS", "  " + "\n  ".join(lines))
