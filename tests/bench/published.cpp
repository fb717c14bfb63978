/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The published recipe (Alhakamy & Tuceryan 2019/20) as its users write it with OpenCV, at full
 * resolution: threshold at the histogram's median, Gaussian blur, erode, dilate with three times
 * the kernel, contours sorted by area, planar moments to a direction, mean colour under a mask,
 * intensity, shadow strength. published.py is the same in Python.
 */
#include <algorithm>
#include <cmath>
#include <cstdio>

#include <opencv2/imgproc.hpp>

#include "contestant.hpp"

namespace
{

constexpr int kKernelPx = 11;

struct light {
	double direction[3], colour[3], intensity, share, area_px;
};

int median_of(const cv::Mat &grey)
{
	const int channel = 0, bins = 256;
	const float range[] = {0, 256}, *ranges[] = {range};
	cv::Mat histogram;
	double below = 0.0;
	int level = 0;

	cv::calcHist(&grey, 1, &channel, cv::Mat(), histogram, 1, &bins, ranges);
	while (level < 255 && (below += static_cast<double>(histogram.at<float>(level))) <
				      static_cast<double>(grey.total()) / 2.0)
		level++;
	return level;
}

std::vector<std::vector<cv::Point>> bright_regions(const cv::Mat &grey)
{
	const cv::Mat small = cv::Mat::ones(kKernelPx, kKernelPx, CV_8U);
	const cv::Mat large = cv::Mat::ones(3 * kKernelPx, 3 * kKernelPx, CV_8U);
	std::vector<std::vector<cv::Point>> contours;
	cv::Mat mask;

	cv::threshold(grey, mask, median_of(grey), 255, cv::THRESH_BINARY);
	cv::GaussianBlur(mask, mask, cv::Size(kKernelPx, kKernelPx), 0);
	cv::erode(mask, mask, small);
	cv::dilate(mask, mask, large);
	cv::threshold(mask, mask, 127, 255, cv::THRESH_BINARY);
	cv::findContours(mask, contours, cv::RETR_EXTERNAL, cv::CHAIN_APPROX_SIMPLE);
	std::sort(contours.begin(), contours.end(), [](const auto &a, const auto &b) {
		return cv::contourArea(a) > cv::contourArea(b);
	});
	return contours;
}

light describe(const cv::Mat &rgb, const std::vector<std::vector<cv::Point>> &contours, int k)
{
	const cv::Moments m = cv::moments(contours[k]);
	cv::Mat mask = cv::Mat::zeros(rgb.size(), CV_8U);

	cv::drawContours(mask, contours, k, cv::Scalar(255), cv::FILLED);
	const cv::Scalar colour = cv::mean(rgb, mask);
	const double theta = M_PI * (m.m01 / m.m00 + 0.5) / rgb.rows;
	const double lambda = 2.0 * M_PI * ((m.m10 / m.m00 + 0.5) / rgb.cols - 0.5);

	return {{std::sin(theta) * std::sin(lambda), std::cos(theta),
		 -std::sin(theta) * std::cos(lambda)},
		{colour[0], colour[1], colour[2]},
		0.299 * colour[0] + 0.587 * colour[1] + 0.114 * colour[2],
		0.0,
		m.m00};
}

struct published final : bench::contestant {
	bench::decoder decoder;
	std::vector<light> lights;

	published() : contestant("published_cpp")
	{
	}

	void run(const bench::picture &p) override
	{
		double sum = 0.0;

		decoder.decode(p);
		const cv::Mat rgb(decoder.height_px, decoder.width_px, CV_8UC3, decoder.rgb.data());
		cv::Mat grey;
		cv::cvtColor(rgb, grey, cv::COLOR_RGB2GRAY);
		const auto contours = bright_regions(grey);
		const int count = static_cast<int>(contours.size());

		lights.clear();
		for (int k = 0; k < count; k++) {
			if (cv::contourArea(contours[k]) <= 0.0)
				break;
			lights.push_back(describe(rgb, contours, k));
			sum += lights.back().intensity;
		}
		for (light &l : lights)
			l.share = l.intensity / sum;
	}

	std::string result() const override
	{
		std::string text = "[";

		for (const light &l : lights) {
			char row[200];

			std::snprintf(row, sizeof(row),
				      "%s{\"direction\": [%.9g, %.9g, %.9g], "
				      "\"colour\": [%.9g, %.9g, %.9g], \"area_px\": %.9g}",
				      text.size() > 1 ? ", " : "", l.direction[0], l.direction[1],
				      l.direction[2], l.colour[0], l.colour[1], l.colour[2],
				      l.area_px);
			text += row;
		}
		return text + "]";
	}
};

} /* namespace */

void bench::add_published(contestants &list)
{
	list.push_back(std::make_unique<published>());
}
