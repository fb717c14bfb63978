/* SPDX-License-Identifier: Apache-2.0 */
/*
 * bench CAMERA PICTURE.jpg...: times what it is told to, so that whoever drives it (bench.py) can
 * let contestants of this and of other processes take turns. Commands on standard input, one JSON
 * line each on standard output:
 *
 *   list                   names of the contestants
 *   run INDEX NAME...      nanoseconds of each contestant's run on picture INDEX, in this order
 *   result INDEX NAME      what the contestant makes of the picture
 */
#include "contestant.hpp"
#include "vision/camera/camera_file.h"

#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iostream>
#include <iterator>
#include <sstream>

#include <opencv2/core.hpp>
#include <turbojpeg.h>

using namespace bench;

void bench::die(const char *what, const char *why)
{
	std::fprintf(stderr, "bench: %s: %s\n", what, why);
	std::exit(1);
}

namespace
{

picture load(const std::filesystem::path &path)
{
	std::ifstream file(path, std::ios::binary);
	picture p = {{std::istreambuf_iterator<char>(file), {}}, 0, 0, {}};
	const tjhandle turbo = tjInitDecompress();
	int subsampling, colourspace;

	if (p.jpeg.empty())
		die(path.c_str(), "no such picture");
	if (tjDecompressHeader3(turbo, p.jpeg.data(), p.jpeg.size(), &p.width_px, &p.height_px,
				&subsampling, &colourspace) < 0)
		die(path.c_str(), tjGetErrorStr2(turbo));
	tjDestroy(turbo);
	return p;
}

/* A picture, and the shorter exposures that lie beside it (frames.py: shoot_bracket()). */
picture load_bracket(const std::filesystem::path &path)
{
	picture p = load(path);
	std::filesystem::path beside = path;

	for (int k = 1; std::filesystem::exists(beside.replace_filename(
		     path.stem().string() + ".exposure" + std::to_string(k) + ".jpg"));
	     k++)
		p.shorter.push_back(load(beside));
	return p;
}

contestant &find(const contestants &list, const std::string &name)
{
	for (const auto &c : list)
		if (c->name == name)
			return *c;
	die(name.c_str(), "no such contestant");
}

void print_names(const contestants &list)
{
	const char *separator = "[";

	for (const auto &c : list) {
		std::cout << separator << '"' << c->name << '"';
		separator = ", ";
	}
	std::cout << "]";
}

void print_times(const contestants &list, const picture &p, std::istringstream &names)
{
	const char *separator = "{";

	for (std::string name; names >> name;)
		for (const timing &t : find(list, name).measure(p)) {
			std::cout << separator << '"' << t.name << "\": " << t.ns;
			separator = ", ";
		}
	std::cout << "}";
}

void obey(const contestants &list, const std::vector<picture> &pictures, const std::string &line)
{
	std::istringstream words(line);
	std::string command, name;
	size_t index = 0;

	words >> command;
	if (command == "list") {
		print_names(list);
	} else {
		if (!(words >> index) || index >= pictures.size())
			die(line.c_str(), "no such picture");
		if (command == "run") {
			print_times(list, pictures[index], words);
		} else if (command == "result" && words >> name) {
			contestant &c = find(list, name);

			c.run(pictures[index]);
			std::cout << c.result();
		} else {
			die(line.c_str(), "want: list | run INDEX NAME... | result INDEX NAME");
		}
	}
	std::cout << std::endl;
}

} /* namespace */

int main(int argc, char **argv)
{
	std::vector<picture> pictures;
	contestants list;
	struct lp_camera_file *camera;

	if (argc < 3)
		die("arguments", "want: bench CAMERA PICTURE.jpg...");
	if (lp_camera_file_read(argv[1], &camera) < 0)
		die(argv[1], "cannot be read");
	for (int i = 2; i < argc; i++)
		pictures.push_back(load_bracket(argv[i]));
	cv::setNumThreads(1);
	add_decodes(list);
	add_pipelines(list, *camera);
	add_stages(list, *camera);
	add_published(list);
	add_projections(list);
	for (std::string line; std::getline(std::cin, line);)
		obey(list, pictures, line);
	lp_camera_file_destroy(camera);
	return 0;
}
