#include "sim_workers/video/video_frame.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <opencv2/imgproc.hpp>

#include "rollout_buffer/core/check.h"
#include "rollout_buffer/core/score_text.h"
#include "rollout_buffer/core/text.h"
#include "rollout_buffer/schema/version.h"

namespace comrad::sim {
namespace {

constexpr int kColumnsMax = 4;  // more views than this go into a second row
constexpr int kFont = cv::FONT_HERSHEY_SIMPLEX;
constexpr double kSmallText = 0.5, kLargeText = 0.62;  // of OpenCV's font, for views 640 pixels wide
constexpr double kSmallestScale = 0.75;                // letters below this cannot be read

const cv::Scalar kBackground(30, 26, 24), kPanel(46, 41, 38), kOutline(86, 78, 72);  // BGR
const cv::Scalar kQuiet(172, 164, 158), kLoud(244, 242, 240), kDark(24, 20, 18), kDead(90, 84, 232);
const cv::Scalar kAccents[] = {{232, 176, 86}, {72, 160, 245},  {118, 196, 110}, {214, 132, 196},
                               {92, 214, 232}, {150, 132, 240}, {190, 190, 120}, {120, 180, 200}};

const cv::Scalar& accent(std::size_t agent) { return kAccents[agent % std::size(kAccents)]; }

template <typename... Values>
std::string format(const char* pattern, Values... values) {
  char text[160];
  std::snprintf(text, sizeof text, pattern, values...);
  return text;
}

/// "move forward" of MOVE_FORWARD.
std::string words_of(const std::string& button) {
  std::string words = lower_case(button);
  std::ranges::replace(words, '_', ' ');
  return words;
}

}  // namespace

VideoFrame::VideoFrame(ViewSize view, int num_agents, const std::vector<std::vector<std::string>>& buttons)
    : view_(view),
      num_agents_(num_agents),
      // 5 agents stand as 3 and 2, not as 4 and 1.
      columns_(num_agents <= kColumnsMax ? num_agents : (num_agents + 1) / 2),
      scale_(std::max(kSmallestScale, view.width / 640.0)),
      planes_(3) {
  lay_out(buttons);
  const int gap = pixels(8), rows = (num_agents + columns_ - 1) / columns_;
  const int width = columns_ * (view.width + gap) + gap;
  const int height = rows * (view.height + caption_height_ + gap) + gap + pixels(34);
  picture_ = cv::Mat(height + height % 2, width + width % 2, CV_8UC3, kBackground);
}

int VideoFrame::pixels(double at_640) const { return static_cast<int>(std::lround(at_640 * scale_)); }

cv::Size VideoFrame::text_size(const std::string& text, double scale) const {
  int below = 0;
  return cv::getTextSize(text, kFont, scale * scale_, 1, &below);
}

void VideoFrame::write(const std::string& text, cv::Point baseline, double scale, const cv::Scalar& color) {
  cv::putText(picture_, text, baseline, kFont, scale * scale_, color, 1, cv::LINE_AA);
}

cv::Point VideoFrame::corner_of(std::size_t agent) const {
  const int column = static_cast<int>(agent) % columns_, row = static_cast<int>(agent) / columns_;
  const int gap = pixels(8);
  return {gap + column * (view_.width + gap), gap + row * (view_.height + caption_height_ + gap)};
}

/// Buttons in rows, as many in each as fit.
void VideoFrame::lay_out(const std::vector<std::vector<std::string>>& buttons) {
  const int edge = pixels(10), height = pixels(24), between = pixels(6);
  int x = edge, y = pixels(32);
  for (std::size_t head = 0; head < buttons.size(); ++head)
    for (std::size_t button = 0; button < buttons[head].size(); ++button) {
      const std::string text = words_of(buttons[head][button]);
      const int width = std::min(text_size(text, kSmallText).width + pixels(16), view_.width - 2 * edge);
      if (x > edge && x + width > view_.width - edge) {
        x = edge;
        y += height + between;
      }
      chips_.push_back({static_cast<int>(head), static_cast<int>(button) + 1, text, {x, y, width, height}});
      x += width + between;
    }
  caption_height_ = y + height + pixels(10);
}

const cv::Mat& VideoFrame::draw(std::span<const std::vector<uint8_t>> views, const VideoCaption& caption) {
  const auto count = static_cast<std::size_t>(num_agents_);
  COMRAD_CHECK(views.size() == count && caption.agents.size() == count, "one view and caption an agent");
  for (std::size_t agent = 0; agent < count; ++agent) {
    draw_view(agent, views[agent]);
    if (drawn_.agents.empty() || drawn_.agents[agent] != caption.agents[agent])
      draw_agent(agent, caption.agents[agent]);
  }
  if (drawn_ != caption) draw_footer(caption), drawn_ = caption;
  return picture_;
}

void VideoFrame::draw_view(std::size_t agent, const std::vector<uint8_t>& view) {
  const std::size_t plane_bytes = static_cast<std::size_t>(view_.width) * view_.height;
  COMRAD_CHECK(view.size() == 3 * plane_bytes, "a view is planar RGB");
  for (std::size_t plane = 0; plane < 3; ++plane)  // cv::Mat has no const view; it is only read
    planes_[2 - plane] =
        cv::Mat(view_.height, view_.width, CV_8UC1, const_cast<uint8_t*>(view.data() + plane * plane_bytes));
  cv::merge(planes_, picture_(cv::Rect(corner_of(agent), cv::Size(view_.width, view_.height))));
}

void VideoFrame::draw_agent(std::size_t agent, const AgentCaption& caption) {
  const cv::Point corner = corner_of(agent) + cv::Point(0, view_.height);
  cv::rectangle(picture_, cv::Rect(corner, cv::Size(view_.width, caption_height_)), kPanel, cv::FILLED);
  cv::rectangle(picture_, cv::Rect(corner, cv::Size(view_.width, pixels(3))), accent(agent), cv::FILLED);
  const int edge = pixels(10), baseline = corner.y + pixels(23);
  write(format("agent %zu", agent), {corner.x + edge, baseline}, kLargeText, accent(agent));
  if (!caption.is_alive)
    write("dead", {corner.x + edge + text_size("agent 0  ", kLargeText).width, baseline}, kLargeText, kDead);
  const std::string score = "J " + score_text(caption.score);
  std::string numbers = score + format("   return %+.2f", caption.return_so_far);
  const int name_width = text_size(caption.is_alive ? "agent 0  " : "agent 0  dead  ", kLargeText).width;
  if (text_size(numbers, kSmallText).width + name_width + 2 * edge > view_.width) numbers = score;
  write(numbers, {corner.x + view_.width - edge - text_size(numbers, kSmallText).width, baseline}, kSmallText,
        kLoud);
  for (const Chip& chip : chips_) {
    const auto head = static_cast<std::size_t>(chip.head);
    const bool is_pressed = head < caption.choice.size() && caption.choice[head] == chip.choice;
    const cv::Rect box = chip.box + corner;
    cv::rectangle(picture_, box, is_pressed ? accent(agent) : kOutline, is_pressed ? cv::FILLED : 1);
    const cv::Size text = text_size(chip.text, kSmallText);
    write(chip.text, {box.x + (box.width - text.width) / 2, box.y + (box.height + text.height) / 2},
          kSmallText, is_pressed ? kDark : kQuiet);
  }
}

void VideoFrame::draw_footer(const VideoCaption& caption) {
  const int gap = pixels(8), top = picture_.rows - pixels(34), baseline = top + pixels(20);
  picture_.rowRange(top, picture_.rows).setTo(kBackground);
  std::string score = "J " + score_text(caption.score);
  if (caption.ceiling > 0) score += " of " + score_text(caption.ceiling);
  const int score_width = text_size(score, kLargeText).width;
  write(score, {picture_.cols - gap - score_width, baseline}, kLargeText, kLoud);
  // What does not fit beside the score is left out, the least needed first.
  const std::string clock = format("%.1f s", static_cast<double>(caption.tics) / kTicRateHz);
  const std::string episode = fmt::format("episode {}", caption.episode);
  const std::string counts = format("tic %u   decision %u", caption.tics, caption.decisions);
  const auto with_ending = [&](std::string text) {
    return caption.ending.empty() ? text : text + "   " + caption.ending;
  };
  for (const std::string& text :
       {with_ending(caption.scenario + "   " + episode + "   " + clock + "   " + counts),
        with_ending(caption.scenario + "   " + episode + "   " + clock), with_ending(episode + "   " + clock),
        with_ending(clock), clock}) {
    if (text_size(text, kSmallText).width + 3 * gap + score_width > picture_.cols) continue;
    write(text, {gap, baseline}, kSmallText, caption.ending.empty() ? kQuiet : kLoud);
    break;
  }
  if (caption.limit_tics == 0) return;
  const int width = picture_.cols - 2 * gap, thickness = std::max(2, pixels(3)),
            y = picture_.rows - pixels(8);
  const double part = std::min(1.0, static_cast<double>(caption.tics) / caption.limit_tics);
  cv::rectangle(picture_, cv::Rect(gap, y, width, thickness), kPanel, cv::FILLED);
  cv::rectangle(picture_, cv::Rect(gap, y, static_cast<int>(width * part), thickness), kQuiet, cv::FILLED);
}

}  // namespace comrad::sim
