/* SPDX-License-Identifier: Apache-2.0 */
/* What stands before the lens: by the command line, else the camera file, else a usual film. */
#ifndef LP_APP_OPTIONS_FILM_OPTIONS_H
#define LP_APP_OPTIONS_FILM_OPTIONS_H

#include "estimate/pipeline.h"

struct lp_camera_file;
struct lp_options;

/* Transmission 0 where nothing is said to stand there. The published stack of three films is one
 * that passes less: its angle is not the wheel's, so that it tells nothing of polarization. */
struct lp_film_numbers lp_film_options(const struct lp_options *options,
				       const struct lp_camera_file *camera);

#endif
