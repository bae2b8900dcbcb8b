//! As a package that colcon builds.

use fss_messages::Definition;
use miette::{IntoDiagnostic, Result, WrapErr};
use std::collections::BTreeSet;
use std::path::Path;

/// Writes a folder for each package of these messages into `folder`; gives the packages' names.
pub(super) fn write(definitions: &[Definition], folder: &Path) -> Result<Vec<String>> {
    let packages: BTreeSet<&str> = definitions.iter().map(|d| d.package.as_str()).collect();
    for package in &packages {
        let folder = folder.join(package);
        std::fs::create_dir_all(folder.join("msg")).into_diagnostic().wrap_err_with(|| folder.display().to_string())?;
        let own: Vec<_> = definitions.iter().filter(|d| d.package == *package).collect();
        let put = |name: &str, text: String| {
            let path = folder.join(name);
            std::fs::write(&path, text).into_diagnostic().wrap_err_with(|| path.display().to_string())
        };
        for definition in &own {
            put(&format!("msg/{}.msg", definition.name), definition.text.clone())?;
        }
        put("package.xml", package_xml(package))?;
        put("CMakeLists.txt", cmake(package, &own))?;
    }
    Ok(packages.into_iter().map(str::to_owned).collect())
}

fn package_xml(package: &str) -> String {
    format!(
        "<?xml version=\"1.0\"?>\n<package format=\"3\">\n  <name>{package}</name>\n  <version>{}</version>\n  \
         <description>Messages of a floating spacecraft simulator</description>\n  \
         <maintainer email=\"fss@localhost\">fss</maintainer>\n  <license>MIT OR Apache-2.0</license>\n  \
         <buildtool_depend>ament_cmake</buildtool_depend>\n  \
         <buildtool_depend>rosidl_default_generators</buildtool_depend>\n  \
         <exec_depend>rosidl_default_runtime</exec_depend>\n  \
         <member_of_group>rosidl_interface_packages</member_of_group>\n  \
         <export>\n    <build_type>ament_cmake</build_type>\n  </export>\n</package>\n",
        env!("CARGO_PKG_VERSION")
    )
}

fn cmake(package: &str, own: &[&Definition]) -> String {
    let files: Vec<_> = own.iter().map(|definition| format!("  \"msg/{}.msg\"\n", definition.name)).collect();
    let files = files.concat();
    format!(
        "cmake_minimum_required(VERSION 3.8)\nproject({package})\n\nfind_package(ament_cmake REQUIRED)\n\
         find_package(rosidl_default_generators REQUIRED)\n\nrosidl_generate_interfaces(${{PROJECT_NAME}}\n{files})\n\n\
         ament_export_dependencies(rosidl_default_runtime)\nament_package()\n"
    )
}
