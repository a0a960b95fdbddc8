/* Counts what a process says to others by MPI, and how long it is in it: preloaded, it stands before Open MPI's functions.

   Fortran's bindings (MUMPS) call PMPI_*, C's and Python's MPI_*: both names lead here, and from here to the library.
   Prototypes are those of Open MPI's binary interface, where every handle is a pointer: no header is needed.
   What goes over a communicator of one process is not counted.  Read by mpi_counter.py. */

#define _GNU_SOURCE
#include <dlfcn.h>
#include <stddef.h>
#include <time.h>

typedef void *H; /* any handle: communicator, datatype, operation, request */
enum { SUM, GATHER, EXCHANGE, MESSAGE, WAIT, KINDS };

double microslip_mpi[2 + 2 * KINDS]; /* wall and processor seconds in MPI; calls by kind; bytes by kind */

static int depth;
static double cost; /* of counting a call, processor seconds, which are no work of the program */

static double now(clockid_t clock) {
  struct timespec t;
  clock_gettime(clock, &t);
  return t.tv_sec + 1e-9 * t.tv_nsec;
}

__attribute__((constructor)) static void weigh(void) {
  double start = now(CLOCK_THREAD_CPUTIME_ID);
  for (int i = 0; i < 1000; i++) now(CLOCK_THREAD_CPUTIME_ID);
  cost = (now(CLOCK_THREAD_CPUTIME_ID) - start) / 1001;
}

static void *library(const char *name) { return dlsym(RTLD_NEXT, name); }

static int asked(const char *name, H comm) {
  int value = 0, (*function)(H, int *) = library(name);
  function(comm, &value);
  return value;
}
static int n_ranks(H comm) { return asked("PMPI_Comm_size", comm); }
static int is_root(int root, H comm) { return asked("PMPI_Comm_rank", comm) == root; }

static double bytes(double n, H type) {
  static int (*size)(H, int *);
  int each = 0;
  if (!size) size = library("PMPI_Type_size");
  size(type, &each);
  return n * each;
}
static double all_of(const int *counts, H comm) {
  double n = 0;
  for (int i = n_ranks(comm); i-- > 0;) n += counts[i];
  return n;
}
static void add(int kind, double calls, double size) {
  microslip_mpi[2 + kind] += calls;
  microslip_mpi[2 + KINDS + kind] += size;
}

/* bytes of persistent requests, known when they are made and counted when they start */
enum { SLOTS = 1 << 14 };
static struct { H request; double size; } kept[SLOTS];
static size_t slot(H request) {
  size_t i = ((size_t)request >> 4) % SLOTS;
  for (size_t tries = 0; tries < SLOTS && kept[i].request && kept[i].request != request; tries++) i = (i + 1) % SLOTS;
  return i;
}
static void keep(H request, double size) {
  size_t i = slot(request);
  kept[i].request = request, kept[i].size = size;
}
static void started(H request) {
  size_t i = slot(request);
  if (kept[i].request == request && kept[i].size >= 0) add(MESSAGE, 1, kept[i].size);
}

/* COUNT is done before the call, AFTER it */
#define CALL(NAME, PARAMS, ARGS, COUNT, AFTER)                                       \
  int MPI_##NAME PARAMS {                                                            \
    static int(*real) PARAMS;                                                        \
    if (!real) real = library("PMPI_" #NAME);                                        \
    if (depth) return real ARGS;                                                     \
    depth++;                                                                         \
    COUNT;                                                                           \
    double busy = now(CLOCK_THREAD_CPUTIME_ID), wall = now(CLOCK_MONOTONIC);         \
    int code = real ARGS;                                                            \
    microslip_mpi[0] += now(CLOCK_MONOTONIC) - wall;                                 \
    microslip_mpi[1] += now(CLOCK_THREAD_CPUTIME_ID) - busy + cost;                  \
    AFTER;                                                                           \
    depth--;                                                                         \
    return code;                                                                     \
  }                                                                                  \
  int PMPI_##NAME PARAMS { return MPI_##NAME ARGS; }

#define OVER(COMM, KIND, SIZE) if (n_ranks(COMM) > 1) add(KIND, 1, SIZE)
#define NOTHING (void)0

#define SEND(NAME) CALL(NAME, (const void *b, int n, H t, int to, int tag, H c), (b, n, t, to, tag, c), OVER(c, MESSAGE, bytes(n, t)), NOTHING)
#define ISEND(NAME) CALL(NAME, (const void *b, int n, H t, int to, int tag, H c, H *r), (b, n, t, to, tag, c, r), OVER(c, MESSAGE, bytes(n, t)), NOTHING)
#define SEND_INIT(NAME, SIZE) CALL(NAME, (const void *b, int n, H t, int to, int tag, H c, H *r), (b, n, t, to, tag, c, r), NOTHING, keep(*r, n_ranks(c) > 1 ? SIZE : -1))
#define WAITS(NAME, PARAMS, ARGS) CALL(NAME, PARAMS, ARGS, add(WAIT, 1, 0), NOTHING)
#define REDUCES(NAME, PARAMS, ARGS) CALL(NAME, PARAMS, ARGS, OVER(c, SUM, bytes(n, t)), NOTHING)

SEND(Send) SEND(Ssend) SEND(Bsend) SEND(Rsend)
ISEND(Isend) ISEND(Issend) ISEND(Ibsend) ISEND(Irsend)
SEND_INIT(Send_init, bytes(n, t)) SEND_INIT(Recv_init, -1)
CALL(Start, (H *r), (r), started(*r), NOTHING)
CALL(Startall, (int n, H *r), (n, r), for (int i = 0; i < n; i++) started(r[i]), NOTHING)
CALL(Sendrecv, (const void *b, int n, H t, int to, int tag, void *b2, int n2, H t2, int from, int tag2, H c, void *s),
     (b, n, t, to, tag, b2, n2, t2, from, tag2, c, s), OVER(c, MESSAGE, bytes(n, t)), NOTHING)

WAITS(Recv, (void *b, int n, H t, int from, int tag, H c, void *s), (b, n, t, from, tag, c, s))
WAITS(Irecv, (void *b, int n, H t, int from, int tag, H c, H *r), (b, n, t, from, tag, c, r))
WAITS(Mrecv, (void *b, int n, H t, H *m, void *s), (b, n, t, m, s))
WAITS(Probe, (int from, int tag, H c, void *s), (from, tag, c, s))
WAITS(Mprobe, (int from, int tag, H c, H *m, void *s), (from, tag, c, m, s))
WAITS(Iprobe, (int from, int tag, H c, int *f, void *s), (from, tag, c, f, s))
WAITS(Wait, (H *r, void *s), (r, s))
WAITS(Waitall, (int n, H *r, void *s), (n, r, s))
WAITS(Waitany, (int n, H *r, int *i, void *s), (n, r, i, s))
WAITS(Waitsome, (int n, H *r, int *m, int *i, void *s), (n, r, m, i, s))
WAITS(Test, (H *r, int *f, void *s), (r, f, s))
WAITS(Testall, (int n, H *r, int *f, void *s), (n, r, f, s))
WAITS(Testany, (int n, H *r, int *i, int *f, void *s), (n, r, i, f, s))
WAITS(Testsome, (int n, H *r, int *m, int *i, void *s), (n, r, m, i, s))

CALL(Barrier, (H c), (c), OVER(c, SUM, 0), NOTHING)
CALL(Ibarrier, (H c, H *r), (c, r), OVER(c, SUM, 0), NOTHING)
REDUCES(Bcast, (void *b, int n, H t, int root, H c), (b, n, t, root, c))
REDUCES(Ibcast, (void *b, int n, H t, int root, H c, H *r), (b, n, t, root, c, r))
REDUCES(Reduce, (const void *b, void *b2, int n, H t, H op, int root, H c), (b, b2, n, t, op, root, c))
REDUCES(Allreduce, (const void *b, void *b2, int n, H t, H op, H c), (b, b2, n, t, op, c))
REDUCES(Iallreduce, (const void *b, void *b2, int n, H t, H op, H c, H *r), (b, b2, n, t, op, c, r))
REDUCES(Scan, (const void *b, void *b2, int n, H t, H op, H c), (b, b2, n, t, op, c))
REDUCES(Exscan, (const void *b, void *b2, int n, H t, H op, H c), (b, b2, n, t, op, c))
CALL(Reduce_scatter, (const void *b, void *b2, const int *n, H t, H op, H c), (b, b2, n, t, op, c),
     OVER(c, SUM, bytes(all_of(n, c), t)), NOTHING)
CALL(Reduce_scatter_block, (const void *b, void *b2, int n, H t, H op, H c), (b, b2, n, t, op, c),
     OVER(c, SUM, bytes((double)n * n_ranks(c), t)), NOTHING)

/* all that is gathered or scattered: the root knows, and of the others' less the largest over the ranks is taken */
CALL(Allgather, (const void *b, int n, H t, void *b2, int n2, H t2, H c), (b, n, t, b2, n2, t2, c),
     OVER(c, GATHER, bytes((double)n2 * n_ranks(c), t2)), NOTHING)
CALL(Allgatherv, (const void *b, int n, H t, void *b2, const int *n2, const int *at, H t2, H c), (b, n, t, b2, n2, at, t2, c),
     OVER(c, GATHER, bytes(all_of(n2, c), t2)), NOTHING)
CALL(Gather, (const void *b, int n, H t, void *b2, int n2, H t2, int root, H c), (b, n, t, b2, n2, t2, root, c),
     OVER(c, GATHER, is_root(root, c) ? bytes((double)n2 * n_ranks(c), t2) : bytes(n, t)), NOTHING)
CALL(Gatherv, (const void *b, int n, H t, void *b2, const int *n2, const int *at, H t2, int root, H c),
     (b, n, t, b2, n2, at, t2, root, c), OVER(c, GATHER, is_root(root, c) ? bytes(all_of(n2, c), t2) : bytes(n, t)), NOTHING)
CALL(Scatter, (const void *b, int n, H t, void *b2, int n2, H t2, int root, H c), (b, n, t, b2, n2, t2, root, c),
     OVER(c, GATHER, is_root(root, c) ? bytes((double)n * n_ranks(c), t) : bytes(n2, t2)), NOTHING)
CALL(Scatterv, (const void *b, const int *n, const int *at, H t, void *b2, int n2, H t2, int root, H c),
     (b, n, at, t, b2, n2, t2, root, c), OVER(c, GATHER, is_root(root, c) ? bytes(all_of(n, c), t) : bytes(n2, t2)), NOTHING)
CALL(Alltoall, (const void *b, int n, H t, void *b2, int n2, H t2, H c), (b, n, t, b2, n2, t2, c),
     OVER(c, EXCHANGE, bytes((double)n2 * n_ranks(c), t2)), NOTHING)
CALL(Alltoallv, (const void *b, const int *n, const int *at, H t, void *b2, const int *n2, const int *at2, H t2, H c),
     (b, n, at, t, b2, n2, at2, t2, c), OVER(c, EXCHANGE, bytes(all_of(n2, c), t2)), NOTHING)

CALL(Comm_dup, (H c, H *new), (c, new), OVER(c, SUM, 0), NOTHING)
CALL(Comm_split, (H c, int colour, int key, H *new), (c, colour, key, new), OVER(c, SUM, 0), NOTHING)
CALL(Comm_create, (H c, H group, H *new), (c, group, new), OVER(c, SUM, 0), NOTHING)
