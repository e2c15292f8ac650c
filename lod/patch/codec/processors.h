#pragma once
// Decoding is compiled for any machine and for machines with AVX2; what lies on its way is inlined into both.
#include "base/simd.h"

#define LUMIGRID_AVX2 target("avx2,bmi,bmi2,popcnt")

/// Code that seldom runs. In the browser, where the rest is built for speed, it is kept small.
#if defined(__EMSCRIPTEN__)
#define LUMIGRID_RARE [[gnu::noinline]]
#else
#define LUMIGRID_RARE LUMIGRID_ALWAYS_INLINE
#endif
