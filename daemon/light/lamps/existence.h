/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Whether what detection finds is a lamp: the probability that it exists, by Bayes' rule
 * (integrated probabilistic data association; Musicki, Evans & Stankovic 1994). The other
 * possibility is clutter: a piece of a bright sky or of a wall, whose borders come and go with
 * noise. How often clutter comes and how soon it goes is measured on the scene. Kept as log odds.
 * Plain data; zeroed is a new one. One thread.
 */
#ifndef LP_LIGHT_LAMPS_EXISTENCE_H
#define LP_LIGHT_LAMPS_EXISTENCE_H

#include <stdbool.h>

struct lp_existence {
	float log_odds;	  /* that it is a lamp */
	bool was_certain; /* at some time */
};

/* What has been seen of clutter. All but age_s are forgotten by and by. */
struct lp_clutter {
	float age_s;	 /* of the map */
	float watched_s; /* how long the scene has been watched */
	float lost;	 /* how many have gone that were never certain */
	float doubted_s; /* how long all have been there, each weighed by its doubt, in sum */
};

/* Time passes. */
void lp_clutter_age(struct lp_clutter *clutter, float elapsed_s);

/* Of what is found for the first time. */
struct lp_existence lp_existence_found(const struct lp_clutter *clutter);

/* Its light has come with it: there is no doubt. */
void lp_existence_prove(struct lp_existence *existence);

/* It has been there, or has been missed, for elapsed_s more. */
void lp_existence_update(struct lp_existence *existence, struct lp_clutter *clutter, bool is_seen,
			 float elapsed_s);

/* More likely than not. */
bool lp_exists(const struct lp_existence *existence);

/* So long a lamp that is beyond doubt stays more likely than not while it is missed, seconds. */
float lp_existence_missed_s(void);

/* Beyond doubt it is gone. */
bool lp_existence_is_over(const struct lp_existence *existence);

/* It is given up. */
void lp_existence_end(const struct lp_existence *existence, struct lp_clutter *clutter);

#endif
