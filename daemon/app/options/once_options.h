/* SPDX-License-Identifier: Apache-2.0 */
/* Options of --once, by which lightprobe estimate says what it wants of pictures, and what the ring
 * read while they were taken. A running daemon has clients and a ring for that. */
#ifndef LP_APP_OPTIONS_ONCE_OPTIONS_H
#define LP_APP_OPTIONS_ONCE_OPTIONS_H

#include "base/param.h"

/* Of struct lp_options. */
extern const struct lp_params lp_once_params;

#endif
