// The viewer of splats, fetched in place of the other when a page shows them (m=qsplat).
export {default} from "client_web_splats.js";
