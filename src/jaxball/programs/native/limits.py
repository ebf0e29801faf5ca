"""Sizes and limits of the compiler, all of them: what is kept in registers, what is written out, what is refused.

They decide how long programs take, to compile and to run. Beside each stands what was measured, or what it follows
from; times are of the paper's ball, and of a hoop that hops. A loop is "written out" if its turns stand one after
another.
"""

# Vectors

# Numbers of a vector: eight doubles are a register of AVX-512. Where registers are shorter, LLVM uses several.
LANES = 8
# Elements of a first axis that is computed in vectors whatever it costs to make these: fewer fill half of one. With
# seven stages, Radau IIA took 0.4 of the time.
FEWEST_ALWAYS = 5
# Elements of a first axis below which nothing is computed in vectors along it: two numbers are two instructions.
SHORTEST_AXIS = 3
# Elements of a first axis that takes vectors. More than eight take two: forward mode in ten directions took half the
# time.
MOST_ROWS = 2 * LANES
# Instructions that make the vectors for one operation on three or four elements, which saves two or three others.
MOST_TO_PACK = 3

# Loops in lanes

# Vectors that the turns of a loop must fill. The last vector computes some turns again, of nine nearly all.
FEWEST = 2
# Operations on single numbers for each number that a turn reads or writes by its index. Moving one takes three
# instructions for every lane, so a program that does little else is shorter without lanes, and as fast.
LEAST_WORK = 8

# Arrays in registers or in memory

# Numbers of an array in registers: of a matrix of nine rows. With 400, LLVM took 1.2 s instead of 0.4 for a gradient,
# and 4.7 s instead of 1.4 for the hoop; with 20, the text of Radau IIA had two fifths more lines.
MOST_REGISTERS = 81
# The longest axis of such an array: longer ones are of many times or switches, not of vectors and stages, and mostly
# indexed by numbers that only a run knows.
LONGEST_AXIS = 48
# Vectors of an array whose first axis takes one, such as a matrix of nine rows in eight directions.
MOST_VECTORS = 100
# Pairs of vectors of an array whose first axis takes two, which fill the registers twice as soon.
MOST_PAIRS = 30
# Numbers of an array that a loop reads and does not change, and that are read once, before it, as tableaus are.
MOST_UNCHANGED = 256
# Formulas within formulas, each of which takes several frames of Python's stack when an element is written.
DEEPEST_FORMULA = 40
# Bytes of an array on the stack, which is short in threads; larger ones are in the memory to work in. A GPU reserves a
# stack for all threads that it could run, eight times as many as do run.
MOST_ON_STACK, MOST_ON_STACK_OF_GPU = 4096, 256
# Bytes at whose multiples arrays begin: a line of the cache, which is a vector of eight doubles as well.
ALIGNMENT = 64

# What is written out

# Turns of a loop, and the numbers computed in all of them: the stages of an explicit method, of up to 16. Their indices
# are known then, zeros of a tableau cost nothing, and stages need not be in memory; the text is up to a third longer.
MOST_TURNS, MOST_NUMBERS = 20, 6000
# Products of numbers in one operation: those of two matrices of eight rows. With more, programs were as long or longer.
MOST_PRODUCTS = 512
# Sums into which a long one is divided: each addition waits some four cycles for the one before.
PARTIAL_SUMS = 4
# Terms of a sum, or of another reduction, of an array in memory: as many as two vectors have numbers.
MOST_TERMS = 16
# Elements in registers each of which is computed by a loop of its own, rather than all in memory by one loop.
MOST_LOOPS = 4
# Operations of a function that is called more than once and still written where it is called. A field of the ball has
# some thousand. With all of them written there, emitting took 0.1 to 0.2 s longer, and LLVM as long.
MOST_INLINED = 200

# Whole programs

# Instructions of a program: more take LLVM longer than XLA.
MOST_LINES = 400_000
# Numbers along an axis that XLA would rather compute in loops of its own, see `pipeline.py`.
LONG_AXIS = 64
# Characters of a program of which quick code needs half a megabyte of stack, twice what optimised code does.
MOST_QUICKLY = 8_000_000
# Characters of a program above which LLVM's scheduler considers fewer instructions at a time: its time is quadratic in
# accesses to the same memory, 50 s of 80 s for a chart of Floquet multipliers.
LONG_PROGRAM = 2_000_000
# Columns that a routine of LAPACK handles together, if it has the memory: LAPACK's own choice.
COLUMNS_OF_BLOCK = 32

# Calls

# Instructions between two checks for signals: a few milliseconds.
PATIENCE = 5_000_000
# Threads that compute blocks besides the one that calls, as many as one processor has or more.
MOST_HELPER_THREADS = 255
# Memories to work in that a program keeps for its next calls: one for each thread of most processors.
SPARE = 16

# On a GPU

# Threads of a group: few, because the registers of a group are free again only when its last run has ended.
THREADS = 64
# Threads of a multiprocessor whose programs take as many registers as they may have: 255 each of 65,536.
THREADS_OF_EACH = 256
# Threads below which too little memory is left.
FEWEST_THREADS = 1_024
# Rows that are started together. Where a display hangs on the GPU, its driver ends what takes more than seconds.
ROWS_OF_LAUNCH = 2**18
# Bytes to work in that a thread has as its own memory, which CUDA reserves for all threads that a GPU can run at once,
# and arranges so that they read side by side. More is one array of XLA's, of which each thread has a part.
MOST_LOCAL = 16_384
# Bytes of the table of arrays, which is an argument of the kernel, and may have no more.
MOST_BYTES_OF_TABLE = 4_096
# Bytes of the driver's text about an error.
LONGEST_LOG = 8_192
