#pragma once

#include <functional>
#include <string>
#include <string_view>

#include "server/report/canvas.h"

/// The frame that Rustle's pages share: style, sections, drawings. Text is escaped unless it is called markup. Pure.
namespace rustle::report {

inline constexpr double kWidePicture = 960, kNarrowPicture = 360;

/// A whole page that needs nothing else: style inline, no script, no link; light or dark as the reader's machine prefers.
std::string html_page(std::string_view title, std::string_view subtitle, std::string_view body_markup,
                      std::string_view footer);

using Draw = std::function<void(Canvas&, const Rect&)>;

/// One inline SVG. `id` is unique in the page.
std::string html_drawing(std::string_view id, std::string_view description, double width, double height,
                         std::string_view css_class, const Draw& draw);

/// A drawing for wide windows and one for phones, of which the style shows one.
std::string html_drawings(std::string_view id, std::string_view description, double wide_height, double narrow_height,
                          const Draw& draw);

/// A panel with a heading, what it shows and a caption below.
std::string html_section(std::string_view title, std::string_view body_markup, std::string_view caption_markup);

/// A headline number for a `<ul class="tiles">`; `tone` is the ink_name of its edge.
std::string html_tile(std::string_view number, std::string_view label, std::string_view tone);

}  // namespace rustle::report
