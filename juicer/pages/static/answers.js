// What is said when the server does not do what a page asks for.

export const NO_ANSWER = "the server does not answer; start `juicer pages` again and open the address that it prints";
