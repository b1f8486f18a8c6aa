//! A robot's bridge for the tests: the plugin `zenoh-plugin-ros2dds` in a zenoh router, run by one configuration file.

use zenoh::config::Config;
use zenoh::internal::{plugins::PluginsManager, runtime::RuntimeBuilder};

#[tokio::main]
async fn main() {
    zenoh::init_log_from_env_or("z=info");
    let mut arguments = std::env::args_os().skip(1);
    let (Some(path), None) = (arguments.next(), arguments.next()) else {
        end(2, "usage: bridge CONFIG.json5");
    };
    let config = Config::from_file(&path).unwrap_or_else(|error| end(2, &format!("{path:?}: {error}")));

    let mut plugins = PluginsManager::static_plugins_only();
    plugins.declare_static_plugin::<zenoh_plugin_ros2dds::ROS2Plugin, &str>("ros2dds", true);
    let built = RuntimeBuilder::new(config).plugins_manager(plugins).build().await;
    let mut runtime = built.unwrap_or_else(|error| end(1, &format!("cannot be built: {error}")));
    if let Err(error) = runtime.start().await {
        end(1, &format!("cannot be started: {error}"));
    }
    std::future::pending::<()>().await
}

fn end(status: i32, message: &str) -> ! {
    eprintln!("bridge: {message}");
    std::process::exit(status)
}
