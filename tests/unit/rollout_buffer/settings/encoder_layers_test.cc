// Encoders and cores as text.
#include "rollout_buffer/settings/encoder_layers.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>

#include "rollout_buffer/settings/layers.h"
#include "rollout_buffer/settings/resolve.h"
#include "tests/support/scratch_folder.h"

namespace comrad {
namespace encoder_layers_test {

using ::testing::AllOf;
using ::testing::HasSubstr;

std::string fault(const std::string& encoder) {
  const auto layers = parse_encoder(encoder);
  return layers ? "" : layers.error().message;
}

TEST(EncoderLayers, EveryNameHasLayersThatReadBackTheSame) {
  for (const std::string& name : encoder_names()) {
    const auto layers = parse_encoder(name);
    ASSERT_TRUE(layers) << name;
    EXPECT_EQ(*parse_encoder(layers_text(*layers)), *layers) << name;
    EXPECT_EQ(canonical_encoder(name), name);
  }
  EXPECT_EQ(layers_text(*parse_encoder("simple")),
            "conv 32 8x8/4, conv 64 4x4/2, conv 128 3x3/2, flatten, linear 512");
}

TEST(EncoderLayers, OneSpellingForEveryWayToWriteAnEncoder) {
  EXPECT_EQ(canonical_encoder("convnet_simple"), "simple");
  EXPECT_EQ(canonical_encoder("Resnet_IMPALA"), "resnet");
  EXPECT_EQ(canonical_encoder(" conv 16  8x8/4 elu,CONV 32 4x4/2 ,flatten,linear 9 none"),
            "conv 16 8x8/4, conv 32 4x4/2, flatten, linear 9 none");
  EXPECT_EQ(canonical_encoder("folder/Vit.pt"), "folder/Vit.pt");
  EXPECT_EQ(canonical_encoder("my_encoder"), "my_encoder");
}

TEST(EncoderLayers, LayerNormalisationStandsBetweenALinearLayerAndItsActivation) {
  const auto normalised = [](const char* layers) {
    return layers_text(with_layer_norm(*parse_encoder(layers)));
  };
  EXPECT_EQ(normalised("impala_small"),
            "conv 16 8x8/4, conv 32 4x4/2, flatten, linear 256 none, layernorm, elu");
  EXPECT_EQ(normalised("conv 8 8x8/4 relu, layernorm, flatten, linear 40 gelu, linear 24 none, tanh"),
            "conv 8 8x8/4 relu, layernorm, flatten, linear 40 none, layernorm, gelu, linear 24 none, tanh");
}

TEST(EncoderLayers, SizesFollowTheLayers) {
  const auto after = [](const char* layer, LayerShape shape) {
    const std::string behind = std::string(layer) == "flatten" ? ", linear 4" : ", flatten, linear 4";
    return shape_after(parse_encoder(layer + behind)->front(), shape);
  };
  const LayerShape frame = {3, 72, 128};
  EXPECT_EQ(after("conv 32 8x8/4", frame)->elements(), 32 * 17 * 31);
  EXPECT_EQ(after("conv 16 3x3 pad 1", frame)->elements(), 16 * 72 * 128);
  EXPECT_EQ(after("pool 3x3/2 pad 1", frame)->elements(), 3 * 36 * 64);
  EXPECT_EQ(after("residual", frame)->elements(), frame.elements());
  EXPECT_TRUE(after("flatten", frame)->is_flat);
}

TEST(EncoderLayers, AFaultNamesTheLayerAndWhatItMayBe) {
  EXPECT_THAT(fault("conv 16 8x8/4, flaten, linear 3"),
              AllOf(HasSubstr("'flaten' is unknown"), HasSubstr("flatten")));
  EXPECT_THAT(fault("conv 0 8x8/4, flatten"), HasSubstr("CHANNELS is a number between 1 and 1024"));
  EXPECT_THAT(fault("conv 8 8x4/4, flatten"), HasSubstr("a window is square"));
  EXPECT_THAT(fault("conv 8 99999999999999999999x3, flatten"), HasSubstr("a window is square"));
  EXPECT_THAT(fault("conv 8 4x4/0, flatten"), HasSubstr("STRIDE up to 16"));
  EXPECT_THAT(fault("conv 8 4x4 pad 3, flatten"), HasSubstr("padding is at most half of the window, 2"));
  EXPECT_THAT(fault("conv 8 4x4 swish, flatten"), HasSubstr("'swish' is no activation"));
  EXPECT_THAT(fault("conv 8 4x4 elu elu, flatten"), HasSubstr("unexpected 'elu'"));
  EXPECT_THAT(fault("conv 8 4x4"), HasSubstr("it must end in features"));
  EXPECT_THAT(fault("linear 8"), HasSubstr("put flatten before it"));
  EXPECT_THAT(fault("flatten, conv 8 4x4"), HasSubstr("it must stand before flatten"));
  EXPECT_THAT(fault("flatten, flatten"), HasSubstr("stands once"));
  EXPECT_THAT(fault("conv 8 32x32/16, conv 8 4x4/4, flatten"), HasSubstr("must not be larger"));
  EXPECT_THAT(fault("conv 64 1x1, flatten"), HasSubstr("put a linear layer behind flatten"));
  std::string many = "elu";
  for (int i = 0; i < 70; ++i) many += ", elu";
  EXPECT_THAT(fault(many + ", flatten"), HasSubstr("more than 64 layers"));
}

TEST(CoreText, IsACellItsSizeAndItsLayers) {
  EXPECT_FALSE(parse_core("none")->use_rnn);
  EXPECT_EQ(parse_core("GRU 256")->size, 256);
  EXPECT_TRUE(parse_core("lstm 512 x2")->is_lstm);
  EXPECT_EQ(parse_core("lstm 512 x2")->layers, 2);
  for (const char* wrong : {"", "gru", "gru 0", "gru 5000", "gru 256 2", "rnn 256", "none 3", "gru 256 x9"})
    EXPECT_FALSE(parse_core(wrong)) << wrong;
}

TEST(NetworkTable, HoldsTheNetworkInOneFile) {
  const test::ScratchFolder folder;
  const auto config_of = [&](const std::string& text) {
    RunConfig config;
    const Expected<SettingsLayer> layer = read_settings_toml(folder.write("network.toml", text));
    EXPECT_TRUE(layer) << layer.error().message;
    const Status applied = apply_layer(config, *layer);
    EXPECT_TRUE(applied) << applied.error().message;
    return config;
  };
  const RunConfig config = config_of(
      "seed = 3\n[network]\nencoder = [\"conv 16 8x8/4\", \"flatten\", \"linear 256\"]\ncore = \"lstm 64 "
      "x2\"\ndecoder = [256, 128]\n");
  EXPECT_EQ(config.run.seed, 3);
  EXPECT_EQ(config.network.encoder, "conv 16 8x8/4, flatten, linear 256");
  EXPECT_EQ(config.network.rnn_type, RnnType::kLstm);
  EXPECT_EQ(config.network.rnn_size, 64);
  EXPECT_EQ(config.network.rnn_num_layers, 2);
  EXPECT_EQ(*parse_widths(config.network.decoder_mlp_layers), (std::vector<int64_t>{256, 128}));
  EXPECT_FALSE(config_of("core = \"none\"\n").network.use_rnn);
  EXPECT_EQ(config_of("encoder_conv_architecture = \"convnet_atari\"\n").network.encoder, "atari");
  EXPECT_EQ(config_of("encoder = \"vit.pt\"\n").network.encoder, folder.string() + "/vit.pt")
      << "beside the file of settings";
  EXPECT_FALSE(read_settings_toml(folder.write("wrong.toml", "[nonsense]\nencoder = \"simple\"\n")));
  EXPECT_FALSE(read_settings_toml(folder.write("wrong.toml", "encoder = [[\"a\"], 3]\n")));
}

TEST(ResolveSettings, ReadsLayersAndLeavesBytesToAModule) {
  RunConfig config;
  config.environment.num_agents = 2;
  config.network.encoder = "conv 16 8x8/4, linear 3";
  const Status refused = resolve_settings(config, 2);
  ASSERT_FALSE(refused);
  EXPECT_THAT(refused.error().message, HasSubstr("put flatten before it"));
  config.network.encoder = "/folder/vit.pt";
  ASSERT_TRUE(resolve_settings(config, 2));
  EXPECT_FALSE(config.network.normalize_input);
}

}  // namespace encoder_layers_test
}  // namespace comrad
