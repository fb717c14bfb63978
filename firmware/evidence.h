/* SPDX-License-Identifier: Apache-2.0 */
/* Internal to wheel.c and evidence.c: what the wheel does (wheel.c) and what is seen of it
 * (evidence.c). */
#ifndef EVIDENCE_H
#define EVIDENCE_H

#include <stdbool.h>
#include <stdint.h>

struct wheel;

/* No angle is outside these; so differences of angles fit in 16 bits. */
#define WHEEL_LOWEST_CDEG (-8000)
#define WHEEL_HIGHEST_CDEG 24000

/* Where the wheel may be. */
struct span {
	int16_t low_cdeg, high_cdeg;
};

/* wheel.c: whether a healthy wheel is at the end of the leg. */
bool wheel_arrived(const struct wheel *wheel);

/* wheel.c: stops everything: fault latched, servo released. */
void wheel_fail(struct wheel *wheel, uint8_t fault, int16_t detail);

/* wheel.c: the number of edges below the wheel has changed. */
void wheel_on_edge(struct wheel *wheel, int16_t before);

/* Angle of an edge of the comb. Beyond its ends: LOWEST or HIGHEST. */
int16_t comb_edge_cdeg(const struct wheel *wheel, int16_t edge);

/* Edges below a target that a move there must pass. One that is close may lie on either side. */
int16_t comb_required(const struct wheel *wheel, int16_t target_cdeg);

/* The wheel is below the comb: counting starts. */
void evidence_start(struct wheel *wheel);

/* A motion begins here: its speed is not that of what came before. */
void evidence_forget_speed(struct wheel *wheel, int16_t angle_cdeg);

/* Every tick: reads the sensors; judges speed and noise. */
void evidence_poll(struct wheel *wheel, uint8_t elapsed_ms);

/* Every tick of a leg: whether the wheel follows. */
void evidence_watch_leg(struct wheel *wheel);

/* Where the wheel is for sure: by the feedback if there is one, and by the comb. False: they
 * contradict each other; the comb's span is given. */
bool evidence_span(const struct wheel *wheel, struct span *span);

/* At rest: fails when the wheel is not at the target any more. */
void evidence_watch_rest(struct wheel *wheel);

#endif
