#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <filesystem>
#include <memory>

#include "server/apps/cloth_picture.h"
#include "server/apps/command_pack.h"
#include "server/apps/pack_picture.h"
#include "server/report/image_canvas.h"

namespace rustle::apps {
namespace {

struct ShowArguments {
  std::string pack, output = "pack.png";
  bool light = false;
};

int run_show(const ShowArguments& arguments) {
  const auto ending = std::filesystem::path(arguments.output).extension();
  if (ending != ".png" && ending != ".html")
    return complain(fmt::format("{}: pictures are .png or .html; name one of them with -o", arguments.output), kWrongUsage);
  const auto pack = load_pack_or_complain(arguments.pack);
  if (!pack) return kFailed;
  tl::expected<void, std::string> written;
  if (ending == ".html") {
    written = report::write_file(arguments.output, pack->cloth ? cloth_pack_page(*pack) : pack_page(*pack));
  } else {
    const double width = pack->cloth ? kClothPictureWidth : kPackPictureWidth;
    const double height = pack->cloth ? kClothPictureHeight : kPackPictureHeight;
    report::ImageCanvas canvas(static_cast<int>(width), static_cast<int>(height),
                               arguments.light ? report::light_theme() : report::dark_theme());
    if (pack->cloth) {
      draw_cloth_pack(canvas, *pack);
    } else {
      draw_pack(canvas, *pack);
    }
    written = report::write_png(arguments.output, canvas.pixels());
  }
  if (!written) return complain(written.error(), kFailed);
  fmt::print("{}: {} drawn\n", arguments.output, pack->name);
  return kDone;
}

}  // namespace

void add_pack_show(CLI::App& pack, Action& action) {
  auto arguments = std::make_shared<ShowArguments>();
  auto* command = pack.add_subcommand(
      "show",
      "Draw a pack: waveforms, friction spectra, centroids and levels over its grid; of cloth its sweep and its units");
  command->footer(
      "Example: rustle pack show printer-paper -o printer-paper.png\n"
      "         rustle pack show my-paper/ -o my-paper.html   # with a table of every sound");
  command->add_option("PACK", arguments->pack, "The pack's folder, or a material that is found")->required();
  command->add_option("-o,--output", arguments->output, "PNG or HTML file to write; pack.png when absent");
  command->add_flag("--light", arguments->light, "Draw the PNG on a light ground");
  command->callback([arguments, &action] { action = [arguments] { return run_show(*arguments); }; });
}

}  // namespace rustle::apps
