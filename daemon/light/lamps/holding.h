/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Where a remembered lamp ends. From panorama to panorama detection may draw the borders of regions
 * anew (two lamps become one region, a lamp becomes part of a sky, or nothing stands out enough),
 * while nothing has changed. A remembered lamp keeps its cells then, and is measured over them, as
 * long as it stands out. One thread.
 */
#ifndef LP_LIGHT_LAMPS_HOLDING_H
#define LP_LIGHT_LAMPS_HOLDING_H

struct lp_detection;
struct lp_lamp_memory;
struct lp_panorama;

/*
 * After lp_detect(): of detection->finder->lamps, those with the cells of a remembered lamp get its
 * known_id; remembered lamps that are found nowhere, or with other borders, are measured over their
 * own cells and join the finder's lamps, in place of those that they share cells with. Other
 * borders that last for longer than LP_BORDERS_S, or than half of the time for which the lamp has
 * been known, are taken as they are. elapsed_s: since the last panorama.
 */
void lp_hold_lamps(struct lp_lamp_memory *memory, struct lp_detection *detection,
		   const struct lp_panorama *panorama, float mean, float elapsed_s);

#define LP_BORDERS_S 4.0F

#endif
