/* SPDX-License-Identifier: Apache-2.0 */
#include "app/options/film_options.h"

#include "app/options/options.h"
#include "light/film/polarization.h"
#include "vision/camera/camera_file.h"

/* A sheet polarizer as they are sold for displays; neither measured nor named. */
#define USUAL_TRANSMISSION 0.84F
#define USUAL_EXTINCTION 500.0F
/* Of the sheets that its polarizing foil lies between: acrylic 1.49, cellulose triacetate 1.48. */
#define USUAL_INDEX 1.5F

static float first_given(float option, float file, float usual)
{
	return option != 0.0F ? option : file != 0.0F ? file : usual;
}

struct lp_film_numbers lp_film_options(const struct lp_options *options,
				       const struct lp_camera_file *camera)
{
	struct lp_film_numbers film = {
		.transmission = first_given(options->polarizer_transmission,
					    camera->film_transmission, USUAL_TRANSMISSION),
		.extinction = first_given(options->polarizer_extinction, camera->film_extinction,
					  USUAL_EXTINCTION),
		.offset_deg =
			first_given(options->polarizer_offset_deg, camera->film_offset_deg, 0.0F),
		.index = first_given(options->polarizer_index, camera->film_index, USUAL_INDEX),
		.is_stack = options->polarizer.mode == LP_POLARIZER_FILMS,
		.rest_s = options->polarizer_rest_s};

	if (options->polarizer.mode == LP_POLARIZER_OFF)
		film.transmission = 0.0F;
	else if (film.is_stack)
		film.transmission = 2.0F * lp_film_stack_gain(film.transmission, film.extinction);
	return film;
}
