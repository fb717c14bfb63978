/* SPDX-License-Identifier: Apache-2.0 */
/* The imager and the veil of the newest frame's lens. */
#include <math.h>

#include "base/log.h"
#include "vision/camera/remap.h"
#include "vision/glare/glare.h"
#include "vision/imager_internal.h"

/* Less than this share of what the camera file states is told, once. */
#define TOLD_BELOW 0.7F
/* The first frame shows its veil as light; and one that contradicts the veil says by how much. */
#define MOST_ROUNDS 4

static void tell(struct lp_glare *glare, const char *camera)
{
	if (glare->told || glare->believed >= TOLD_BELOW)
		return;
	glare->told = true;
	lp_warning(camera, "glare",
		   "dark places of its pictures hold less light than the veil that [glare] of its "
		   "camera file states: %.0f %% of it is taken off; measure it anew: lightprobe "
		   "check-camera",
		   100.0 * (double)glare->believed);
}

void lp_imager_look_through_veil(struct lp_imager *imager)
{
	struct lp_eye *eye = imager->eye;

	if (!eye->glare)
		return;
	for (int round = 0; round < MOST_ROUNDS; round++) {
		const struct lp_residual residual = lp_imager_residual(imager);
		const bool is_first = !eye->glare->known;

		lp_glare_look(eye->glare, &residual, eye->over_film);
		lp_imager_map(imager);
		if (!is_first && eye->glare->allowed == 1.0F)
			break;
	}
	tell(eye->glare, eye->camera->name);
}

void lp_imager_weigh_veil(struct lp_imager *imager, struct lp_observation *seen)
{
	struct lp_glare *glare = imager->eye->glare;

	if (!glare)
		return;
	const struct lp_residual residual = lp_imager_residual(imager);

	lp_glare_turn(glare, &residual, imager->eye->over_film);
	seen->veil = glare->turned;
	seen->veil_variance = glare->turned_variance;
}

float lp_eye_veil_sigma(const struct lp_eye *eye)
{
	if (!eye->glare || !eye->remap)
		return 0.0F;
	return eye->glare->sigma * eye->remap->seen_fraction;
}
