/* SPDX-License-Identifier: Apache-2.0 */
#ifndef LP_SOURCE_LIBCAMERA_NEUTRAL_HPP
#define LP_SOURCE_LIBCAMERA_NEUTRAL_HPP

#include <libcamera/controls.h>

#include "drivers/source/libcamera/c.hpp"

namespace lp
{

/*
 * Ask in `wanted` for neutral values of all processing that a camera with these controls lists.
 * What cannot be neutral is on in `report`. libcamera has no way to ask for the values in force.
 */
void neutralize(const libcamera::ControlInfoMap &has, libcamera::ControlList &wanted,
		lp_processing_report &report);

/* A request with all that was refused: what neutralize() asked for is taken out of `wanted`, and on
 * in `report`. False: nothing was. */
bool give_up_neutral(libcamera::ControlList &wanted, lp_processing_report &report);

} // namespace lp

#endif
