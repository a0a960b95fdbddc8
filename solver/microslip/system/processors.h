/* A kernel is compiled once for each kind of processor, and the one for this processor selected at run time.  Vector types require
 * separate files: operations missing in the baseline of x86-64 are lowered before a function's own target attribute applies.
 *
 * Its header defines DECLARE(suffix), the declarations of its entry points with a suffix, and then uses DECLARE_KERNELS. */
#ifndef MICROSLIP_PROCESSORS_H
#define MICROSLIP_PROCESSORS_H

#if defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__) && !defined(__INTEL_COMPILER) && __GNUC__ >= 12
#define FOR_EACH_PROCESSOR
#define DECLARE_KERNELS DECLARE(_baseline) DECLARE(_v3) DECLARE(_v4)
#define OF_THIS_PROCESSOR(name)                                                                                              \
    (__builtin_cpu_supports("x86-64-v4") ? name##_v4 : __builtin_cpu_supports("x86-64-v3") ? name##_v3 : name##_baseline)
#else
#define DECLARE_KERNELS DECLARE(_baseline)
#define OF_THIS_PROCESSOR(name) name##_baseline
#endif

#endif
