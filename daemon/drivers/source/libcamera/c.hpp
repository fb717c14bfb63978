/* SPDX-License-Identifier: Apache-2.0 */
/* The daemon's C headers, for the C++ of this driver. */
#ifndef LP_SOURCE_LIBCAMERA_C_HPP
#define LP_SOURCE_LIBCAMERA_C_HPP

#include <math.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

extern "C" {
#include "base/backoff.h"
#include "base/clock.h"
#include "base/log.h"
#include "base/pool.h"
#include "drivers/source/exposure_guess.h"
#include "drivers/source/frame_clock.h"
#include "drivers/source/frames.h"
#include "drivers/source/libcamera/settings.h"
#include "drivers/source/offers.h"
#include "drivers/source/outbox.h"
#include "drivers/source/processing.h"
#include "drivers/source/report.h"
#include "include/frame.h"
#include "include/source.h"
}

#endif
