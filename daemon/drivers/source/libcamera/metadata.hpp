/* SPDX-License-Identifier: Apache-2.0 */
#ifndef LP_SOURCE_LIBCAMERA_METADATA_HPP
#define LP_SOURCE_LIBCAMERA_METADATA_HPP

#include <libcamera/controls.h>

struct lp_frame;

namespace lp
{

/*
 * Fill in what a finished request reports of its frame: exposure_us, gain (analogue times digital),
 * and t_start_ns, the start of exposure. `stamp_ns`, CLOCK_MONOTONIC: when the sensor began to send
 * the frame, its first row exposed by then. False: the request reports no exposure (as libcamera's
 * pipeline for USB cameras), and the frame is left as it is.
 */
bool describe_frame(const libcamera::ControlList &metadata, int64_t stamp_ns,
		    struct lp_frame &frame);

} // namespace lp

#endif
