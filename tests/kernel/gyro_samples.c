/* SPDX-License-Identifier: Apache-2.0 */
/* gyro_samples URI — print what an orientation sensor tells the daemon, a line for each sample: its
 * time in ns, the rates about x, y, z in degrees per second, and their sigma. Until it is killed.
 */
#include <inttypes.h>
#include <math.h>
#include <stdio.h>

#include "app/backends.h"
#include "base/loop.h"
#include "include/orientation.h"

#define DEG (M_PI / 180.0)

static void on_sample(void *context, const struct lp_orientation_sample *sample)
{
	const double *rate = sample->rate_rad_s;

	(void)context;
	(void)printf("%" PRId64 " %.4f %.4f %.4f %.4f\n", sample->t_ns, rate[0] / DEG,
		     rate[1] / DEG, rate[2] / DEG, sample->sigma / DEG);
	(void)fflush(stdout);
}

static void on_fault(void *context, const char *id, const char *text)
{
	(void)context;
	(void)printf("fault %s %s\n", id, text ? text : "is over");
}

static void on_end(void *context, int signal_number)
{
	(void)signal_number;
	lp_loop_stop(context);
}

int main(int argc, char **argv)
{
	struct lp_orientation_host host = {.sample = on_sample, .fault = on_fault};
	struct lp_orientation *sensor;
	struct lp_loop *loop;

	if (argc != 2 || lp_loop_create(&loop) < 0 || lp_loop_on_end(loop, on_end, loop) < 0)
		return 2;
	host.loop = loop;
	if (lp_orientation_open(argv[1], &host, &sensor) < 0 || sensor->ops->start(sensor) < 0)
		return 1;
	lp_loop_run(loop);
	sensor->ops->destroy(sensor);
	lp_loop_destroy(loop);
	return 0;
}
