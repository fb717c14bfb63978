/* SPDX-License-Identifier: Apache-2.0 */
#ifndef LP_SOURCE_LIBCAMERA_METADATA_HPP
#define LP_SOURCE_LIBCAMERA_METADATA_HPP

#include <libcamera/controls.h>

struct lp_frame;

namespace lp
{

/*
 * Fill in what a finished request reports of its frame: exposure_us and gain (analogue times
 * digital). False: the request reports no exposure (as libcamera's pipeline for USB cameras), and
 * the frame is left as it is.
 */
bool describe_frame(const libcamera::ControlList &metadata, struct lp_frame &frame);

} // namespace lp

#endif
