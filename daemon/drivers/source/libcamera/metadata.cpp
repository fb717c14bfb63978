/* SPDX-License-Identifier: Apache-2.0 */
#include "drivers/source/libcamera/metadata.hpp"

#include <libcamera/control_ids.h>

#include "drivers/source/libcamera/c.hpp"

namespace controls = libcamera::controls;

bool lp::describe_frame(const libcamera::ControlList &metadata, lp_frame &frame)
{
	const auto exposure_us = metadata.get(controls::ExposureTime);
	const auto gain = metadata.get(controls::AnalogueGain);

	if (!exposure_us || !gain)
		return false;
	frame.exposure_us = static_cast<float>(*exposure_us);
	frame.gain = *gain * metadata.get(controls::DigitalGain).value_or(1.0F);
	return true;
}
