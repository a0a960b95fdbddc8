/* The kernel for processors with AVX-512. */
#include "elastic_coulomb.h"
#ifdef FOR_EACH_PROCESSOR
#pragma GCC target("arch=x86-64-v4")
#define LANES 8
#define KERNEL(name) name##_v4
#include "elastic_coulomb.c"
#endif
