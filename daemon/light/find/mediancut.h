/* SPDX-License-Identifier: Apache-2.0 */
/* A constellation of lights for a whole panorama: Debevec 2005, "A median cut algorithm for light
 * probe sampling". */
#ifndef LP_LIGHT_FIND_MEDIANCUT_H
#define LP_LIGHT_FIND_MEDIANCUT_H

struct lp_lamp_finder;
struct lp_panorama;

/* `count` lights (at most LP_MAX_LAMPS) into finder->lamps, strongest first. All light goes into
 * them: no background is taken off. The part with the most light is halved until there are enough.
 */
void lp_mediancut(struct lp_lamp_finder *finder, const struct lp_panorama *panorama, int count);

#endif
