# nix run 'git+file:.?dir=packaging/nix' -- build scan.ply
{
  description = "Triangle meshes of any size at every level of detail, with proven errors";

  inputs.nixpkgs.url = "github:NixOS/nixpkgs/nixos-unstable";

  outputs = { self, nixpkgs }:
    let
      systems = [ "x86_64-linux" "aarch64-linux" "x86_64-darwin" "aarch64-darwin" ];
      forEach = f: nixpkgs.lib.genAttrs systems (system: f nixpkgs.legacyPackages.${system});
      source = ../..;
      manifest = nixpkgs.lib.importTOML (source + "/Cargo.toml");
    in {
      packages = forEach (pkgs: {
        default = pkgs.rustPlatform.buildRustPackage {
          pname = "chpm";
          version = manifest.workspace.package.version;
          src = source;
          cargoLock.lockFile = source + "/Cargo.lock";
          # The tests ask for a display, a browser and Python.
          doCheck = false;
          nativeBuildInputs = [ pkgs.makeWrapper ];
          # The window finds these when it starts.
          postFixup = pkgs.lib.optionalString pkgs.stdenv.hostPlatform.isLinux ''
            wrapProgram $out/bin/chpm --prefix LD_LIBRARY_PATH : ${
              pkgs.lib.makeLibraryPath [
                pkgs.vulkan-loader
                pkgs.libGL
                pkgs.libxkbcommon
                pkgs.wayland
                pkgs.xorg.libX11
                pkgs.xorg.libXcursor
                pkgs.xorg.libXi
              ]
            }
          '';
          meta = {
            description = "Triangle meshes of any size at every level of detail, with proven errors";
            license = [ pkgs.lib.licenses.mit pkgs.lib.licenses.asl20 ];
            mainProgram = "chpm";
          };
        };
      });
    };
}
