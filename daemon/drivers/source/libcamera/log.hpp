/* SPDX-License-Identifier: Apache-2.0 */
#ifndef LP_SOURCE_LIBCAMERA_LOG_HPP
#define LP_SOURCE_LIBCAMERA_LOG_HPP

namespace lp
{

/* libcamera's own messages go to the daemon's log from now on: errors and warnings as warnings, the
 * rest as debug. Safe to call again. */
void take_over_log();

} // namespace lp

#endif
