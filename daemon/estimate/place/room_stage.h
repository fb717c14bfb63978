/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The room around a probe that goes, from frame to frame: pictures of the panorama for the fit
 * (light/place/room.h), and what an estimate says of it. Owned and called by the pipeline.
 */
#ifndef LP_ESTIMATE_PLACE_ROOM_STAGE_H
#define LP_ESTIMATE_PLACE_ROOM_STAGE_H

struct lp_detection;
struct lp_estimate_room;
struct lp_lamp_memory;
struct lp_panorama;
struct lp_probe_pose;
struct lp_room;

/* The newest panorama, anchor frame, seen from `pose`; lamps in it are those that detection has
 * found, and those that are remembered.
 */
void lp_room_stage_look(struct lp_room *room, const struct lp_panorama *panorama,
			const struct lp_detection *detection, const struct lp_lamp_memory *memory,
			const struct lp_probe_pose *pose);

/* What is known of the room in which `pose` is, anchor frame. */
void lp_room_stage_tell(const struct lp_room *room, const struct lp_probe_pose *pose,
			struct lp_estimate_room *told);

#endif
