/* The kernel for processors with AVX2. */
#include "elastic_coulomb.h"
#ifdef FOR_EACH_PROCESSOR
#pragma GCC target("arch=x86-64-v3")
#define LANES 4
#define KERNEL(name) name##_v3
#include "elastic_coulomb.c"
#endif
