/* SPDX-License-Identifier: Apache-2.0 */
/*
 * OpenCV's universal intrinsics: one source for NEON and x86. Outside of OpenCV's own build its
 * headers use no more of x86 than SSE2; the daemon is built for x86-64-v2 (SSE4.1), so say so
 * before they look.
 */
#ifndef LP_VISION_PICTURE_SIMD_HPP
#define LP_VISION_PICTURE_SIMD_HPP

#ifdef __SSE4_1__
#include <smmintrin.h>
#define CV_SSE3 1
#define CV_SSSE3 1
#define CV_SSE4_1 1
#endif

#include <opencv2/core/hal/intrin.hpp>

#endif
