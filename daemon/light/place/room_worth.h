/* SPDX-License-Identifier: Apache-2.0 */
/* How far a box can be believed: by pictures from several places (light/place/room_fit.h). Pure. */
#ifndef LP_LIGHT_PLACE_ROOM_WORTH_H
#define LP_LIGHT_PLACE_ROOM_WORTH_H

#include "light/place/room_fit.h"

/*
 * How wrong light is that is moved through the box from one place to another one, as spherical
 * harmonics up to each order: root mean square of the irradiance over all normals, relative to its
 * mean, for each metre. INFINITY: it is no less wrong than if it is not moved. `late_s`: how old
 * the light in a picture is. `bare_error_per_m`: the same of light without area lights.
 */
void lp_room_find_errors(const struct lp_box_rays *rays, const struct lp_room_views *views,
			 const struct lp_box *box, double late_s, double error_per_m[LP_BOX_ORDERS],
			 double bare_error_per_m[LP_BOX_ORDERS]);

#endif
