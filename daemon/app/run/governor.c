/* SPDX-License-Identifier: Apache-2.0 */
#include "app/run/governor.h"

#include <stdio.h>

#include "base/clock.h"

/* Chosen by hand; docs/maintainers/constants.md says which tests notice other values. */

/* One estimate in ten may be late: a busy machine hiccups. */
#define MOST_LATE 10
/* Room to spare: below this share of the goal. The next preset up costs from little more to ten
 * times as much (docs/maintainers/speed.md): a raise may fail, and the wait for the next one
 * doubles then. */
#define SPARE 0.5F
/* Of windows with room to spare, before a preset is raised. One that is missed as soon after
 * should not have been raised; one that lasts longer was right. */
#define FIRST_PATIENCE 5
#define MOST_PATIENCE 160

void lp_governor_init(struct lp_governor *governor, const struct lp_governor_goals *goals,
		      int chosen, int64_t now_ns, int64_t cpu_ns)
{
	*governor = (struct lp_governor){.goals = *goals,
					 .chosen = chosen,
					 .preset = chosen,
					 .window_ns = now_ns,
					 .window_cpu_ns = cpu_ns,
					 .settling = true,
					 .patience = FIRST_PATIENCE,
					 .since_raise = FIRST_PATIENCE};
}

void lp_governor_estimate(struct lp_governor *governor, int64_t latency_ns)
{
	const float latency_ms = (float)((double)latency_ns / LP_NS_PER_MS);
	const float goal_ms = governor->goals.latency_ms;

	governor->estimates++;
	if (goal_ms > 0.0F && latency_ms > goal_ms)
		governor->late++;
	if (goal_ms > 0.0F && latency_ms > SPARE * goal_ms)
		governor->close++;
}

static void begin_window(struct lp_governor *governor, int64_t now_ns, int64_t cpu_ns)
{
	governor->window_ns = now_ns;
	governor->window_cpu_ns = cpu_ns;
	governor->estimates = governor->late = governor->close = 0;
}

static void change(struct lp_governor *governor, int steps)
{
	governor->preset += steps;
	governor->settling = true;
	governor->spare = 0;
}

/* The window has missed a goal: `reason` says which and by how much. */
static bool missed(const struct lp_governor *governor, float cpu_percent, char *reason,
		   size_t reason_bytes)
{
	const struct lp_governor_goals *goals = &governor->goals;

	if (governor->late * MOST_LATE > governor->estimates) {
		(void)snprintf(reason, reason_bytes, "%d of %d estimates later than %g ms",
			       governor->late, governor->estimates, (double)goals->latency_ms);
		return true;
	}
	if (goals->cpu_percent > 0.0F && cpu_percent > goals->cpu_percent) {
		(void)snprintf(reason, reason_bytes, "%.0f %% of a core used, %g allowed",
			       (double)cpu_percent, (double)goals->cpu_percent);
		return true;
	}
	return false;
}

static bool lower(struct lp_governor *governor)
{
	governor->spare = 0;
	if (governor->since_raise < FIRST_PATIENCE && governor->patience < MOST_PATIENCE)
		governor->patience *= 2;
	governor->since_raise = FIRST_PATIENCE;
	if (governor->preset == 0)
		return false;
	change(governor, -1);
	return true;
}

static bool raise(struct lp_governor *governor, float cpu_percent, char *reason,
		  size_t reason_bytes)
{
	const struct lp_governor_goals *goals = &governor->goals;
	const bool spare = governor->close * MOST_LATE <= governor->estimates &&
			   (goals->cpu_percent <= 0.0F || cpu_percent < SPARE * goals->cpu_percent);

	if (governor->since_raise < FIRST_PATIENCE && ++governor->since_raise == FIRST_PATIENCE)
		governor->patience = FIRST_PATIENCE;
	governor->spare = spare ? governor->spare + 1 : 0;
	if (governor->preset == governor->chosen || governor->spare < governor->patience)
		return false;
	(void)snprintf(reason, reason_bytes, "well below its limits for %d s",
		       (int)(governor->spare * LP_GOVERNOR_WINDOW_NS / LP_NS_PER_S));
	change(governor, 1);
	governor->since_raise = 0;
	return true;
}

bool lp_governor_tick(struct lp_governor *governor, int64_t now_ns, int64_t cpu_ns, char *reason,
		      size_t reason_bytes)
{
	const int64_t elapsed_ns = now_ns - governor->window_ns;
	bool changed = false;

	if (elapsed_ns < LP_GOVERNOR_WINDOW_NS)
		return false;
	if (governor->settling) {
		governor->settling = false;
	} else if (governor->estimates > 0) {
		const float cpu_percent =
			(float)(100.0 * (double)(cpu_ns - governor->window_cpu_ns) /
				(double)elapsed_ns);

		changed = missed(governor, cpu_percent, reason, reason_bytes)
				  ? lower(governor)
				  : raise(governor, cpu_percent, reason, reason_bytes);
	}
	begin_window(governor, now_ns, cpu_ns);
	return changed;
}

void lp_governor_refused(struct lp_governor *governor, int preset)
{
	governor->preset = preset;
}
